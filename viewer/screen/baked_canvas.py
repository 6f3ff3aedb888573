"""A baked object drawn by OpenGL: a ray through every pixel of the view, samples along it in a 3D texture."""

import time
from typing import Any

import moderngl
import numpy as np
from imgui_bundle import imgui
from jaxtyping import UInt8

from core.geometry.camera import Camera
from core.rendering.baked_field import LOGITS, MIN_LIGHT, BakedField
from core.rendering.occupancy import CELLS
from viewer.screen.canvas import SCREEN, Target
from viewer.screen.theme import DARK, Palette
from viewer.screen.window import in_software
from viewer.values.orbit import PanelCrop

_FAST = 1 / 60
"""s: OpenGL is fast if a picture of :data:`_PROBE` takes no longer"""
_PROBE = 512
"""px of a side"""
_PROBES = 3
_FRAGMENT = """
#version 330
uniform sampler3D texels;     // rgb and logit; the axes are z, y, x
uniform usampler3D distance;  // cells to the nearest occupied one
uniform vec3 origin, right, up, backward, extent, top, bottom;
uniform vec2 middle;          // of the picture, px from the first pixel shown
uniform vec2 logits;          // least, most
uniform float focal, pace, cells, blocks, density_scale, min_light;
in vec2 uv;
out vec4 colour;
void main() {
    vec2 pixel = (gl_FragCoord.xy - middle) / focal;
    vec3 along = normalize(right * pixel.x - up * pixel.y - backward);
    along = mix(along, vec3(1e-9), lessThan(abs(along), vec3(1e-9)));
    vec3 first = (-extent - origin) / along, second = (extent - origin) / along;
    vec3 low = min(first, second), high = max(first, second);
    float near = max(0.0, max(low.x, max(low.y, low.z))), far = min(high.x, min(high.y, high.z));
    int count = int(ceil((far - near) / pace - 0.5));
    vec3 seen = vec3(0.0);
    float light = 1.0;
    for (int i = 0; i < count && light > min_light;) {
        vec3 place = (origin + along * (near + (float(i) + 0.5) * pace)) / extent;
        vec3 block = clamp(floor((place + 1.0) * 0.5 * blocks), 0.0, blocks - 1.0);
        int empty = int(texelFetch(distance, ivec3(block).zyx, 0).r);
        if (empty > 0) {  // leave the cube of empty cells around this one
            vec3 face = block + mix(vec3(1 - empty), vec3(empty), greaterThan(along, vec3(0.0)));
            vec3 leave = ((face * 2.0 / blocks - 1.0) * extent - origin) / along;
            i = max(i + 1, int(ceil((min(leave.x, min(leave.y, leave.z)) - near) / pace - 0.5)));
            continue;
        }
        vec4 texel = texture(texels, (((place + 1.0) * 0.5 * cells + 0.5) / (cells + 1.0)).zyx);
        float logit = mix(logits.x, logits.y, texel.a);
        float density = density_scale * (max(logit, 0.0) + log(1.0 + exp(-abs(logit))));
        float left = light * exp(-density * pace);
        seen += (light - left) * texel.rgb;
        light = left;
        i++;
    }
    colour = vec4(seen + light * mix(top, bottom, smoothstep(0.25, 1.0, uv.y)), 1.0);
}
"""


class BakedCanvas:
    """The object from any camera at every pixel of the view, on the view's background."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context, self._target = context, Target(context)
        self._program = context.program(vertex_shader=SCREEN, fragment_shader=_FRAGMENT)
        self._program["texels"], self._program["distance"] = 0, 1
        self._program["blocks"], self._program["logits"], self._program["min_light"] = CELLS, LOGITS, MIN_LIGHT
        self._pass = context.vertex_array(self._program, [])
        self._textures: tuple[moderngl.Texture3D, ...] = ()
        self._baked: BakedField | None = None
        self._shown: tuple[Any, ...] = ()

    def draw(self, baked: BakedField, crop: PanelCrop, palette: Palette) -> imgui.ImTextureRef:
        """A texture of the crop's size; rendered again only where something has changed."""
        if (baked, crop, palette) != self._shown:
            self._upload(baked)
            self._render(baked, crop, palette)
            self._shown = baked, crop, palette
        return imgui.ImTextureRef(self._target.texture.glo)

    def pixels(self) -> UInt8[np.ndarray, "height width 3"]:
        """What was drawn last."""
        texture = self._target.texture
        return np.frombuffer(texture.read(), np.uint8).reshape(*texture.size[::-1], 4)[..., :3]

    def release(self) -> None:
        """Give the GL objects back."""
        self._target.release()
        self._pass.release()
        self._program.release()
        for texture in self._textures:
            texture.release()

    def _upload(self, baked: BakedField) -> None:
        if baked is self._baked:
            return
        for texture in self._textures:
            texture.release()
        sides = (len(baked.texels),) * 3
        texels = self._context.texture3d(sides, 4, baked.texels.tobytes())
        texels.repeat_x = texels.repeat_y = texels.repeat_z = False
        distance = self._context.texture3d((CELLS,) * 3, 1, baked.distance.tobytes(), dtype="u1")
        distance.filter = moderngl.NEAREST, moderngl.NEAREST
        self._textures, self._baked = (texels, distance), baked

    def _render(self, baked: BakedField, crop: PanelCrop, palette: Palette) -> None:
        camera, program = crop.camera, self._program
        rotation, origin = camera.pose().numpy()[:3, :3], camera.pose().numpy()[:3, 3]
        # The columns of a pose are right, down and forward.
        signs = ("right", 1), ("up", -1), ("backward", -1)
        for column, (name, sign) in enumerate(signs):
            program[name] = tuple(sign * rotation[:, column])
        program["origin"], program["extent"] = tuple(origin), baked.extent
        offset = baked.pixel_offset
        program["middle"] = camera.width / 2 - crop.left + offset, camera.height / 2 - crop.top + offset
        program["focal"], program["pace"], program["cells"] = camera.focal, baked.step, baked.cells
        program["density_scale"] = baked.density_scale
        program["top"], program["bottom"] = palette.background
        for place, texture in enumerate(self._textures):
            texture.use(place)
        with self._target.of_size((crop.width, crop.height)):
            self._pass.render(moderngl.TRIANGLES, vertices=3)


def is_fast(context: moderngl.Context) -> bool:
    """Whether OpenGL draws a baked object in no more than a frame's time: not if the processor does it."""
    return not in_software(context) and seconds_per_picture(context) <= _FAST


def seconds_per_picture(context: moderngl.Context) -> float:
    """What a picture of a baked ball takes, 512 px a side; the least of a few."""
    canvas, times = BakedCanvas(context), list[float]()
    baked = _ball()
    for number in range(_PROBES + 1):  # the first one uploads, and compiles the shader
        crop = PanelCrop(Camera(0.1 * number, 0.3, 2.0, 1.5 * _PROBE, _PROBE, _PROBE), _PROBE, _PROBE)
        context.finish()
        began = time.perf_counter()
        canvas.draw(baked, crop, DARK)
        context.finish()
        times.append(time.perf_counter() - began)
    canvas.release()
    return min(times[1:])


def _ball() -> BakedField:
    """Soft, so that rays pass many samples."""
    axis = np.linspace(-1, 1, 2 * CELLS + 1, dtype=np.float32)
    radius = np.sqrt(axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2)
    texels = np.full((*radius.shape, 4), 128, np.uint8)
    texels[..., 3] = np.clip(200 * (1.2 - radius), 0, 70)
    return BakedField(texels, np.zeros((CELLS,) * 3, np.uint8), (0.5, 0.5, 0.5), 30.0, 0.0, 2 * CELLS)
