"""OpenGL drawing of the ground shadow (:mod:`core.rendering.ground_shadow`) over a background."""

import moderngl
import numpy as np

from core.geometry.camera import Camera
from core.gl.camera_uniforms import camera_uniforms
from core.rendering.ground_shadow import GroundShadow

VERTEX = """
#version 330
uniform vec3 origin, right, up, backward;
uniform vec2 reach, middle, size;  // of the map, scene units; px
uniform float height, focal;
out vec2 place;
void main() {
    place = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    vec3 away = vec3((2.0 * place - 1.0) * reach, height) - origin;
    vec2 offset = vec2(dot(right, away), -dot(up, away)) * focal;
    float before = -dot(backward, away);
    gl_Position = vec4(2.0 * (offset + middle * before) / size - before, 0.0, before);
}
"""
FRAGMENT = """
#version 330
uniform sampler2D darkness;
in vec2 place;
out vec4 colour;
void main() { colour = vec4(0.0, 0.0, 0.0, texture(darkness, place).r); }
"""


class GroundShader:
    """The program and the map of one shadow. Its GL context must be current in every call."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._program = context.program(vertex_shader=VERTEX, fragment_shader=FRAGMENT)
        self._plane = context.vertex_array(self._program, [])
        self._map: moderngl.Texture | None = None
        self._shadow: GroundShadow | None = None

    def draw(
        self, shadow: GroundShadow, camera: Camera, size: tuple[int, int], corner: tuple[int, int] = (0, 0)
    ) -> None:
        """Darken the current framebuffer, first row topmost, where the camera sees the shadow.

        Args:
            size: width and height of the framebuffer, px.
            corner: left and top of the framebuffer in the camera's image, px.
        """
        view = camera_uniforms(camera)
        if view["origin"][2] <= shadow.height:
            return
        self._upload(shadow)
        middle = camera.width / 2 - corner[0], camera.height / 2 - corner[1]
        image = {"focal": camera.focal, "size": size, "middle": middle}
        for name, value in (view | image | {"reach": shadow.reach, "height": shadow.height}).items():
            self._program[name] = value
        assert self._map is not None
        self._map.use(0)
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        self._plane.render(moderngl.TRIANGLE_STRIP, vertices=4)
        self._context.disable(moderngl.BLEND)

    def _upload(self, shadow: GroundShadow) -> None:
        if shadow is self._shadow:
            return
        size = shadow.darkness.shape[1], shadow.darkness.shape[0]
        if self._map is None or self._map.size != size:
            if self._map is not None:
                self._map.release()
            self._map = self._context.texture(size, 1, alignment=1)
            self._map.repeat_x = self._map.repeat_y = False
        self._map.write(np.ascontiguousarray(shadow.darkness), alignment=1)
        self._shadow = shadow

    def release(self) -> None:
        """Release the GL objects."""
        for resource in (self._map, self._plane, self._program):
            if resource is not None:
                resource.release()
