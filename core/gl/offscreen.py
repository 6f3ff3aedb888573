"""Off-screen images of baked fields by OpenGL, in a context of their own (EGL)."""

import moderngl
import numpy as np
from jaxtyping import UInt8

from core.geometry.camera import Camera
from core.gl.background import GLSL, Background, edges
from core.gl.baked_field import BakedField
from core.gl.baked_shader import BakedShader
from core.gl.ground_shader import GroundShader

_VERTEX = """
#version 330
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }
"""
_FRAGMENT = """
#version 330
uniform sampler2D fine;   // colours times opacity, and opacity
uniform int factor;
uniform float height;     // px; 0 where there is no background
out vec4 colour;
BACKGROUND
void main() {
    vec4 mean = vec4(0.0);
    ivec2 corner = ivec2(gl_FragCoord.xy) * factor;
    for (int y = 0; y < factor; ++y)
        for (int x = 0; x < factor; ++x) mean += texelFetch(fine, corner + ivec2(x, y), 0);
    mean /= float(factor * factor);
    vec3 own = mean.rgb / max(mean.a, 0.004);
    vec3 behind = background(gl_FragCoord.y / max(height, 1.0));
    colour = height > 0.0 ? vec4(mean.rgb + (1.0 - mean.a) * behind, 1.0) : vec4(own, mean.a);
}
""".replace("BACKGROUND", GLSL)


class OffscreenRenderer:
    """Draws baked fields into images. Use it as a context manager, on one thread.

    Args:
        size: px, width and height.
        supersampling: samples of a pixel along each axis.
        background: None: images are transparent.

    Raises ``RuntimeError`` if the machine has no OpenGL.
    """

    def __init__(
        self, size: tuple[int, int], supersampling: int = 1, background: Background | None = (255,) * 3
    ) -> None:
        try:
            self._context = moderngl.create_context(standalone=True, backend="egl", require=330)  # type: ignore[arg-type]
        except Exception as error:  # moderngl raises bare Exception
            raise RuntimeError(f"no OpenGL 3.3 through EGL: {error}") from error
        context = self._context
        self._size = size
        self._fine_size = (size[0] * supersampling, size[1] * supersampling)
        self._transparent = background is None
        self._shader = BakedShader(context)
        self._ground = GroundShader(context)
        self._samples = context.texture(self._fine_size, 4)
        self._fine = context.framebuffer([self._samples])
        self._result = context.framebuffer([context.renderbuffer(size, 4)])
        resolve = context.program(vertex_shader=_VERTEX, fragment_shader=_FRAGMENT)
        resolve["factor"] = supersampling
        resolve["height"] = float(size[1] if background else 0)
        for name, edge in zip(("top", "bottom"), edges(background or (0, 0, 0)), strict=True):
            resolve[name] = tuple(channel / 255 for channel in edge)
        self._resolve = context.vertex_array(resolve, [])

    def __enter__(self) -> "OffscreenRenderer":
        return self

    def __exit__(self, *error: object) -> None:
        self._context.release()

    def draw(self, baked: BakedField, camera: Camera) -> UInt8[np.ndarray, "height width channels"]:
        """Draw the camera's image, with the field's shadow if it has one.

        RGB on the background; without a background, RGB and straight alpha.
        """
        # Entering makes this context current; until now it may have been that of the program's window.
        with self._context as context:
            self._shader.upload(baked)
            self._fine.use()
            self._fine.clear()
            fine = camera.resized(*self._fine_size)
            if baked.shadow:
                self._ground.draw(baked.shadow, fine, self._fine_size)
            self._shader.draw(fine, self._fine_size)
            self._result.use()
            context.enable_only(moderngl.NOTHING)
            self._samples.use(0)
            self._resolve.render(moderngl.TRIANGLES, vertices=3)
            channels = 4 if self._transparent else 3
            pixels = np.frombuffer(self._result.read(components=channels, alignment=1), np.uint8)
        return pixels.reshape(*self._size[::-1], channels)
