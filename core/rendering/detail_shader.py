"""What a photo adds to colours (:class:`core.rendering.detail_maps.DetailMaps`), in GLSL: one surface point a pixel."""

from typing import Any

import moderngl
import numpy as np

from core.geometry.camera import Camera
from core.rendering.detail_maps import BESIDE, DEPTH_FAR, DEPTH_NEAR, FACING, FLAT, STEEP, DetailMaps

GLSL = f"""
uniform sampler2D fine, mirrored, surface;
uniform vec3 photo_origin;
uniform mat3 photo_axes;  // right, up, backward
uniform vec2 photo_focal; // in widths and heights of the photo
uniform float level;
float smooth_step(float zero, float one, float value) {{
    float share = clamp((value - zero) / (one - zero), 0.0, 1.0);
    return share * share * (3.0 - 2.0 * share);
}}
// How far the photo's camera saw a point, and where in its image.
float seen_by_photo(vec3 point, vec3 along, out vec2 place) {{
    vec3 away = point - photo_origin, local = photo_axes * away;
    place = 0.5 + vec2(local.x, -local.y) * photo_focal / max(-local.z, 1e-6);
    vec4 found = textureLod(surface, place, 0.0);
    float reached = length(away);
    vec3 ray = away / max(reached, 1e-6);
    float same = smooth_step({DEPTH_FAR}, {DEPTH_NEAR}, abs(reached - found.a));
    float facing = smooth_step(0.0, {FACING}, -dot(along, found.xyz));
    float steep = smooth_step({FLAT}, {STEEP}, -dot(ray, found.xyz));
    float beside = smooth_step({BESIDE[0]}, {BESIDE[1]}, dot(ray, along));
    bool inside = local.z < 0.0 && place == clamp(place, 0.0, 1.0);
    return inside ? same * max(facing * steep, beside) : 0.0;
}}
vec3 detail(vec3 point, vec3 along) {{
    vec2 place, twin;
    float direct = seen_by_photo(point, along, place);
    vec4 own = direct * textureLod(fine, place, level);
    vec3 turn = vec3(-1.0, 1.0, 1.0);
    float other = seen_by_photo(point * turn, along * turn, twin);
    return strength * (own.rgb + (1.0 - own.a) * other * textureLod(mirrored, twin, 0.0).rgb);
}}
"""
"""``detail(point, along)``: what is added to the colour of a place seen along a unit vector; ``strength`` is declared
before it"""


class DetailTextures:
    """The maps in one context, loaded again only where they are others."""

    names = "fine", "mirrored", "surface"

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._of: object = None
        self._textures: list[moderngl.Texture] = []

    def upload(self, maps: DetailMaps | None) -> None:
        """Load maps in place of the last ones, unless there are none."""
        if maps is None or maps.fine is self._of:
            return
        self.release()
        for map in (maps.fine[0], maps.mirrored, maps.surface):
            channels, height, width = map.shape
            pixels = np.ascontiguousarray(map.movedim(0, -1).cpu().numpy().astype(np.float16))
            texture = self._context.texture((width, height), channels, pixels.tobytes(), alignment=1, dtype="f2")
            texture.repeat_x = texture.repeat_y = False
            texture.filter = moderngl.LINEAR, moderngl.LINEAR
            self._textures.append(texture)
        self._textures[0].build_mipmaps(max_level=len(maps.fine) - 1)
        self._textures[0].filter = moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR
        self._of = maps.fine

    def use(self, unit: int) -> None:
        """Bind them, in the order of their names, from a unit on."""
        for number, texture in enumerate(self._textures, unit):
            texture.use(number)

    def release(self) -> None:
        """Give the GL objects back."""
        while self._textures:
            self._textures.pop().release()
        self._of = None


def uniforms(maps: DetailMaps, camera: Camera) -> dict[str, Any]:
    """The values that the GLSL needs for a camera's image."""
    photo, pose = maps.camera, maps.camera.pose().numpy()
    axes = np.stack((pose[:3, 0], -pose[:3, 1], -pose[:3, 2]))  # the columns of a pose are right, down and forward
    return {
        "photo_origin": tuple(pose[:3, 3]),
        "photo_axes": tuple(axes.T.ravel()),
        "photo_focal": (photo.focal / photo.width, photo.focal / photo.height),
        "level": float(maps.level(camera)),
    }
