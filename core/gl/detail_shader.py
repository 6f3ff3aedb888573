"""Photo detail (:class:`core.detail.lookup.DetailMaps`) in GLSL, for one surface point per pixel."""

from typing import Any

import moderngl
import numpy as np
import torch

from core.detail import lookup
from core.detail.lookup import NEAR, NEAR_DEPTHS, DetailMaps, PhotoMaps
from core.edits.edit import UNIT, Edit
from core.geometry.camera import Camera
from core.gl.camera_uniforms import camera_uniforms
from core.models.photo_detail import MAX_PHOTOS

_MAPS = "fine", "mirrored", "surface"
_PHOTO = """
    if (photos > PHOTO) {
        float near, visible = photo_weights(surfacePHOTO, PHOTO, point, from, along, place, near);
        vec4 value = textureLod(finePHOTO, place, level[PHOTO]);
        near *= clamp(2.0 * value.a, 0.0, 1.0);
        float weight = max(visible * clamp(2.0 * value.a - 1.0, 0.0, 1.0), near);
        own += (weight * weight + NEAR_FIRST * near) * vec4(value.rgb, 1.0);
        direct = max(direct, weight);
        visible = photo_weights(surfacePHOTO, PHOTO, point * turn, from * turn, along * turn, place, near);
        value = textureLod(mirroredPHOTO, place, level[PHOTO]);
        weight = mirrors * visible * clamp(2.0 * value.a - 1.0, 0.0, 1.0);
        twin += weight * weight * vec4(value.rgb, 1.0);
        mirror = max(mirror, weight);
    }"""
_EACH = "".join(_PHOTO.replace("PHOTO", str(number)) for number in range(MAX_PHOTOS))
_SAMPLERS = ", ".join(f"{name}{number}" for number in range(MAX_PHOTOS) for name in _MAPS)
_GLSL = f"""
uniform float strength;
uniform sampler2D {_SAMPLERS};
uniform int photos;
uniform float mirrors;  // 1: the other side has the colours of the mirror image; 0: the model's
uniform vec3 gain, offset;
uniform vec3 photo_origin[{MAX_PHOTOS}];
uniform mat3 photo_axes[{MAX_PHOTOS}];  // right, up, backward
uniform vec2 photo_focal[{MAX_PHOTOS}]; // in widths and heights of the photo
uniform float level[{MAX_PHOTOS}];
uniform vec3 proportions;  // of the space of the viewer
float smooth_step(float start, float end, float value) {{
    float progress = clamp((value - start) / (end - start), 0.0, 1.0);
    return progress * progress * (3.0 - 2.0 * progress);
}}
// DetailMaps' two weights of a photo for a point and its origin, and the place of that in the photo.
float photo_weights(
    sampler2D surface, int photo, vec3 point, vec3 from, vec3 along, out vec2 place, out float near
) {{
    vec3 away = from - photo_origin[photo], local = photo_axes[photo] * away;
    place = 0.5 + vec2(local.x, -local.y) * photo_focal[photo] / max(-local.z, 1e-6);
    vec4 hit = textureLod(surface, place, 0.0);  // normal and distance of the surface that the photo shows there
    float reached = length(away), behind = abs(reached - hit.a);
    vec3 ray = away / max(reached, 1e-6);
    float facing = smooth_step(0.0, {lookup.FACING}, -dot(along, hit.xyz));
    float steep = smooth_step({lookup.FLAT}, {lookup.STEEP}, -dot(ray, hit.xyz));
    vec3 line = proportions == vec3(1.0) ? along : normalize(along * proportions);
    float angle = dot(normalize(point * proportions - photo_origin[photo]), line);
    float beside = smooth_step({lookup.BESIDE[0]}, {lookup.BESIDE[1]}, angle);
    float inside = local.z < 0.0 && place == clamp(place, 0.0, 1.0) ? 1.0 : 0.0;
    near = inside * smooth_step({NEAR[0]}, {NEAR[1]}, angle) * smooth_step({NEAR_DEPTHS[0]}, {NEAR_DEPTHS[1]}, behind);
    return inside * smooth_step({lookup.DEPTH_FAR}, {lookup.DEPTH_NEAR}, behind) * max(facing * steep, beside);
}}
vec3 detail(vec3 point, vec3 along, vec3 model) {{
    vec2 place;
    vec3 from = ORIGIN, turn = vec3(-1.0, 1.0, 1.0);
    vec4 own = vec4(0.0), twin = vec4(0.0);
    float direct = 0.0, mirror = 0.0;{_EACH.replace("NEAR_FIRST", str(lookup.NEAR_FIRST))}
    vec3 matched = model * (gain - 1.0) + offset;
    vec3 reflected = twin.rgb / max(twin.a, 1e-6) - model;
    return strength * mix(mix(matched, reflected, mirror), own.rgb / max(own.a, 1e-6) - model, direct);
}}
"""


def glsl(edits: tuple[Edit, ...]) -> str:
    """Return a function ``detail(point, along, model)``, and the uniforms that it declares.

    It returns the change of the model's colour at a point of an edited object, seen along a unit vector.
    """
    moving = [edit for edit in edits if edit.glsl]
    origin = "point"
    for edit in reversed(moving):
        origin = f"{edit.key}_origins({origin})"
    return "".join(edit.glsl for edit in moving) + _GLSL.replace("ORIGIN", origin)


class DetailTextures:
    """Photo detail maps as textures of one GL context, uploaded only after a change."""

    names = tuple(f"{name}{number}" for number in range(MAX_PHOTOS) for name in _MAPS)

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._uploaded: tuple[PhotoMaps, ...] | None = None
        self._textures: list[moderngl.Texture] = []

    def upload(self, maps: DetailMaps | None) -> None:
        """Upload maps, which replace the previous ones; None keeps the previous ones."""
        if maps is None or maps.photos == self._uploaded:
            return
        self.release()
        for photo in maps.photos:
            fine = mirrored = self._levels(photo.fine)
            if photo.mirrored is not photo.fine:
                mirrored = self._levels(photo.mirrored)
            self._textures += [fine, mirrored, self._texture(photo.surface)]
        self._uploaded = maps.photos

    def _levels(self, levels: tuple[torch.Tensor, ...]) -> moderngl.Texture:
        texture = self._texture(levels[0])
        texture.build_mipmaps(max_level=len(levels) - 1)
        texture.filter = moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR
        return texture

    def _texture(self, map: torch.Tensor) -> moderngl.Texture:
        channels, height, width = map.shape
        pixels = np.ascontiguousarray(map.movedim(0, -1).cpu().numpy().astype(np.float16))
        texture = self._context.texture((width, height), channels, pixels.tobytes(), alignment=1, dtype="f2")
        texture.repeat_x = texture.repeat_y = False
        texture.filter = moderngl.LINEAR, moderngl.LINEAR
        return texture

    def use(self, unit: int) -> None:
        """Bind the textures to units from ``unit`` on, in the order of their names."""
        for number, texture in enumerate(self._textures, unit):
            texture.use(number)

    def release(self) -> None:
        """Release the GL objects."""
        while self._textures:
            self._textures.pop().release()
        self._uploaded = None


def uniforms(maps: DetailMaps, camera: Camera) -> dict[str, Any]:
    """Return the uniforms of :func:`glsl` for a camera's image, without strength and samplers."""
    photos = [*maps.photos, *maps.photos[-1:] * MAX_PHOTOS][:MAX_PHOTOS]  # arrays must be written whole
    cameras = [photo.camera for photo in photos]
    views = [camera_uniforms(view) for view in cameras]
    axes = [np.stack((view["right"], view["up"], view["backward"]), -1) for view in views]
    return {
        "photos": len(maps.photos),
        "mirrors": float(maps.other_side == "mirrored"),
        "gain": maps.match.gain,
        "offset": maps.match.offset,
        "photo_origin": [view["origin"] for view in views],
        "photo_axes": [tuple(matrix.ravel()) for matrix in axes],
        "photo_focal": [(view.focal / view.width, view.focal / view.height) for view in cameras],
        "level": [float(photo.level(camera)) for photo in photos],
        "proportions": maps.proportions or UNIT,
    } | {name: value for edit in maps.edits for name, value in edit.uniforms().items()}
