"""OpenGL drawing of the ground over a background: the shadow (:mod:`core.rendering.ground_shadow`), and a ring.

The ring around the object is green on the sides that photos show, and grey on the others.
"""

import math
from collections.abc import Sequence

import moderngl
import numpy as np

from core.classifiers.viewpoint import SEEN_ANGLE
from core.geometry.camera import Camera
from core.gl.camera_uniforms import camera_uniforms
from core.models.photo_detail import MAX_PHOTOS
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
const float RADIUS = 0.55, WIDTH = 0.008;  // fractions of the map's reach
const vec3 SEEN = vec3(0.25, 0.72, 0.38), GUESSED = vec3(0.55);
uniform sampler2D darkness;
uniform vec2 reach, directions[PHOTOS];  // of the photos' cameras on the ground, of length 1
uniform int photos;
in vec2 place;
out vec4 colour;
void main() {
    colour = vec4(0.0, 0.0, 0.0, texture(darkness, place).r);
    if (photos == 0) return;
    vec2 away = 2.0 * place - 1.0;
    bool seen = false;
    for (int i = 0; i < photos; ++i) seen = seen || dot(normalize(away * reach), directions[i]) > SEES;
    float soft = fwidth(length(away));
    float ring = 0.9 * (1.0 - smoothstep(WIDTH - soft, WIDTH + soft, abs(length(away) - RADIUS)));
    colour = vec4(0.0, 0.0, 0.0, colour.a) * (1.0 - ring) + vec4(seen ? SEEN : GUESSED, 1.0) * ring;
}
""".replace("PHOTOS", str(MAX_PHOTOS)).replace("SEES", f"{math.cos(SEEN_ANGLE):.4f}")


class GroundShader:
    """The program and the map of one shadow. Its GL context must be current in every call."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._program = context.program(vertex_shader=VERTEX, fragment_shader=FRAGMENT)
        self._plane = context.vertex_array(self._program, [])
        self._map: moderngl.Texture | None = None
        self._shadow: GroundShadow | None = None

    def draw(
        self,
        shadow: GroundShadow,
        camera: Camera,
        size: tuple[int, int],
        corner: tuple[int, int] = (0, 0),
        azimuths: Sequence[float] = (),
    ) -> None:
        """Darken the current framebuffer, first row topmost, where the camera sees the shadow, and draw the ring.

        Args:
            size: width and height of the framebuffer, px.
            corner: left and top of the framebuffer in the camera's image, px.
            azimuths: of the object's photos, rad, at most :data:`MAX_PHOTOS`; without photos there is no ring.
        """
        view = camera_uniforms(camera)
        if view["origin"][2] <= shadow.height:
            return
        self._upload(shadow)
        middle = camera.width / 2 - corner[0], camera.height / 2 - corner[1]
        image = {"focal": camera.focal, "size": size, "middle": middle}
        directions = [(math.cos(azimuth), math.sin(azimuth)) for azimuth in azimuths]
        ring = {"photos": len(directions), "directions": directions + [(0.0, 0.0)] * (MAX_PHOTOS - len(directions))}
        for name, value in (view | image | ring | {"reach": shadow.reach, "height": shadow.height}).items():
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
