"""Off-screen rendering of coloured triangles: one object in daylight, on white, antialiased."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import moderngl
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from core.geometry.camera import Camera

SUPERSAMPLES = 4  # samples a pixel along each axis; the pixel is their mean


def _unit(x: float, y: float, z: float) -> Float[np.ndarray, "3"]:
    return np.array((x, y, z)) / np.linalg.norm((x, y, z))


DAYLIGHT = {
    "key": _unit(0.5, 0.65, 1.0),
    "fill": _unit(-0.8, 0.1, 0.35),
    "powers": (0.52, 0.2, 0.14),
    "sky": (0.26, 0.46),
}
"""Key, fill and back light at infinity, and a sky; fixed to the world, from the front right, above.

Matt shading: a point has the same colour from every direction. Directions (world) point to the lights. Powers are in
linear light, relative to the surface's colour: of key, fill and back on a surface facing them, of the sky facing down
and up. A surface whose powers add up to 1 shows its own colour."""

_VERTEX = """
#version 330
uniform mat4 clip_from_world;
in vec3 place; in vec3 normal; in vec3 colour; in vec2 uv;
out vec3 world; out vec3 facing; out vec3 paint; out vec2 coordinate;
void main() {
    world = place; facing = normal; paint = colour; coordinate = uv;
    gl_Position = clip_from_world * vec4(place, 1.0);
}
"""

_FRAGMENT = """
#version 330
uniform sampler2D albedo;
uniform vec3 eye;
uniform vec3 key; uniform vec3 fill;  // unit vectors
uniform vec3 powers;  // of key, fill and back
uniform vec2 sky;
in vec3 world; in vec3 facing; in vec3 paint; in vec2 coordinate;
out vec4 result;
const vec3 BACK = normalize(vec3(0.2, -1.0, 0.2));
vec3 linear(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c)); }
vec3 display(vec3 c) { return mix(c * 12.92, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)); }
void main() {
    vec4 texel = texture(albedo, coordinate);
    if (texel.a < 0.5) discard;
    // Meshes disagree on which side is out: the side that faces the camera is lit.
    vec3 flat_normal = normalize(cross(dFdx(world), dFdy(world)));
    flat_normal *= sign(dot(flat_normal, eye - world));
    vec3 n = length(facing) > 0.1 ? normalize(facing) : flat_normal;
    n *= dot(n, flat_normal) < 0.0 ? -1.0 : 1.0;
    vec3 lit = powers * max(vec3(dot(n, key), dot(n, fill), dot(n, BACK)), 0.0);
    float light = mix(sky.x, sky.y, 0.5 + 0.5 * n.z) + lit.x + lit.y + lit.z;
    result = vec4(display(min(linear(paint * texel.rgb) * light, 1.0)), 1.0);
}
"""

_DOWNSAMPLE = """
#version 330
uniform sampler2D fine;
uniform int factor;
out vec4 result;
void main() {
    vec4 total = vec4(0.0);
    ivec2 corner = ivec2(gl_FragCoord.xy) * factor;
    for (int y = 0; y < factor; ++y)
        for (int x = 0; x < factor; ++x) total += texelFetch(fine, corner + ivec2(x, y), 0);
    result = total / float(factor * factor);
}
"""

_FULL_SCREEN = """
#version 330
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }
"""


@dataclass(frozen=True)
class Surface:
    """Triangles with one texture. Raises ``ValueError`` for arrays that do not match."""

    vertices: Float[np.ndarray, "vertices 3"]  # world
    normals: Float[np.ndarray, "vertices 3"]  # world, either side; zero: flat shading
    faces: Int[np.ndarray, "faces 3"]
    colours: Float[np.ndarray, "vertices 3"]  # sRGB, 0..1; multiplies the texture
    uvs: Float[np.ndarray, "vertices 2"] | None = None  # (0, 0) is the texture's top left; repeats
    texture: UInt8[np.ndarray, "height width 4"] | None = None  # sRGB and alpha; transparent below a half

    def __post_init__(self) -> None:
        count = len(self.vertices)
        if self.normals.shape != (count, 3) or self.colours.shape != (count, 3):
            raise ValueError(f"a surface of {count} vertices needs as many normals and colours")
        if self.texture is not None and (self.uvs is None or self.uvs.shape != (count, 2)):
            raise ValueError("a textured surface needs texture coordinates")
        if self.faces.size and not 0 <= self.faces.min() <= self.faces.max() < count:
            raise ValueError(f"faces must point at the {count} vertices")
        if not np.isfinite(self.vertices).all():
            raise ValueError("vertices must be finite")


class Rasteriser:
    """An off-screen GL context for images of one size, on one thread. ``RuntimeError`` if there is no OpenGL."""

    def __init__(self, size: int) -> None:
        try:
            self._context = moderngl.create_context(standalone=True, backend="egl", require=330)  # type: ignore[arg-type]
        except Exception as error:  # moderngl raises bare Exception
            raise RuntimeError(f"rendering needs OpenGL 3.3 through EGL, and this machine has none: {error}") from error
        context = self._context
        fine = size * SUPERSAMPLES
        self._size = size
        self._samples = context.texture((fine, fine), 4)
        self._fine = context.framebuffer([self._samples], context.depth_renderbuffer((fine, fine)))
        self._small = context.framebuffer([context.renderbuffer((size, size), 4)])
        self._program = context.program(vertex_shader=_VERTEX, fragment_shader=_FRAGMENT)
        downsample = context.program(vertex_shader=_FULL_SCREEN, fragment_shader=_DOWNSAMPLE)
        downsample["factor"] = SUPERSAMPLES
        self._downsample = context.vertex_array(downsample, [])
        self._plain = context.texture((1, 1), 4, b"\xff\xff\xff\xff")
        self._batches: list[tuple[moderngl.VertexArray, moderngl.Texture]] = []
        self._resources = ExitStack()  # releases those of the batches
        for name, value in DAYLIGHT.items():
            self._program[name].write(np.asarray(value, np.float32).tobytes())  # type: ignore[union-attr]

    def __enter__(self) -> "Rasteriser":
        return self

    def __exit__(self, *_: object) -> None:
        with self._context:
            self._resources.close()
        self._context.release()

    def upload(self, surfaces: Sequence[Surface]) -> None:
        """Load an object, replacing the last one."""
        plain = [surface for surface in surfaces if surface.texture is None]
        with self._context:
            self._resources.close()
            self._batches.clear()
            for group in ([plain] if plain else []) + [[s] for s in surfaces if s.texture is not None]:
                self._batches.append(self._batch(group))

    def render(self, camera: Camera) -> tuple[UInt8[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]:
        """Return the object's image on white, and the mask of pixels covered by half or more.

        Raises ``ValueError`` for a camera of another size.
        """
        if (camera.width, camera.height) != (self._size, self._size):
            raise ValueError(f"this rasteriser renders {self._size} px, not {camera.width}x{camera.height}")
        # Near and far planes around the object, whose bounding box has a diagonal of 1.
        clip_from_world = camera.clip_from_world(max(camera.distance - 0.75, 0.02), camera.distance + 0.75)
        eye = camera.pose()[:3, 3].numpy().astype(np.float32)
        # Entering makes this context current: the program's window or another rasteriser may have been.
        with self._context as context:
            self._fine.use()
            context.enable_only(moderngl.DEPTH_TEST)
            context.clear(1.0, 1.0, 1.0, 0.0)
            self._program["clip_from_world"].write(clip_from_world.T.tobytes())  # type: ignore[union-attr]
            self._program["eye"].write(eye.tobytes())  # type: ignore[union-attr]
            for array, texture in self._batches:
                texture.use(0)
                array.render(moderngl.TRIANGLES)
            self._small.use()
            context.enable_only(moderngl.NOTHING)
            self._samples.use(0)
            self._downsample.render(moderngl.TRIANGLES, vertices=3)
            read = np.frombuffer(self._small.read(components=4), np.uint8)
        # GL counts rows from the bottom.
        pixels = read.reshape(self._size, self._size, 4)[::-1]
        return np.ascontiguousarray(pixels[..., :3]), pixels[..., 3] > 127

    def _batch(self, group: Sequence[Surface]) -> tuple[moderngl.VertexArray, moderngl.Texture]:
        """Combine surfaces that share a texture into one draw call."""
        blank = [s.uvs if s.uvs is not None else np.zeros((len(s.vertices), 2)) for s in group]
        rows = [np.hstack((s.vertices, s.normals, s.colours, uv)) for s, uv in zip(group, blank, strict=True)]
        starts = np.cumsum([0] + [len(s.vertices) for s in group])
        faces = np.vstack([s.faces + start for s, start in zip(group, starts[:-1], strict=True)])
        vertices = self._context.buffer(np.vstack(rows).astype(np.float32).tobytes())
        indices = self._context.buffer(faces.astype(np.int32).tobytes())
        layout = [(vertices, "3f 3f 3f 2f", "place", "normal", "colour", "uv")]
        array = self._context.vertex_array(self._program, layout, indices)
        texture = self._plain
        if (pixels := group[0].texture) is not None:
            texture = self._context.texture(pixels.shape[1::-1], 4, np.ascontiguousarray(pixels).tobytes())
            texture.build_mipmaps()
            texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
            self._resources.callback(texture.release)
        for resource in (vertices, indices, array):
            self._resources.callback(resource.release)
        return array, texture
