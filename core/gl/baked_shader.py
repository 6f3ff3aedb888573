"""Ray marching of a baked field with OpenGL, on screen or off.

Draws only the tiles of the image that show occupied cells, and limits their rays to the depths of these cells. Software
OpenGL also evaluates discarded fragments, so an empty pixel would cost as much as several samples.
"""

import math
from typing import Any

import moderngl
import numpy as np
import torch
from jaxtyping import Float32
from torch.nn import functional

from core.detail.lookup import MIN_OPACITY, DetailMaps
from core.geometry.camera import Camera
from core.gl.baked_field import LOGITS, MIN_LIGHT, BakedField
from core.gl.camera_uniforms import camera_uniforms
from core.gl.detail_shader import DetailTextures, glsl, uniforms
from core.rendering.occupancy import CELLS
from core.rendering.splatting import splat

VERTEX = """
#version 330
uniform vec2 tiles;  // columns, rows
in vec4 tile;        // column, row; nearest and farthest distance of the cells behind it
flat out vec2 reach;
void main() {
    vec2 corner = tile.xy + vec2(gl_VertexID & 1, gl_VertexID >> 1);
    reach = tile.zw;
    gl_Position = vec4(2.0 * corner / tiles - 1.0, 0.0, 1.0);
}
"""
FRAGMENT = """
#version 330
uniform sampler3D texels;     // rgb and logit; the axes are z, y, x
uniform usampler3D distance;  // cells to the nearest occupied one
uniform vec3 origin, right, up, backward, extent, first, sides;
uniform vec2 middle;          // of the camera's image, px from the first pixel drawn
uniform vec2 logits;          // least, range; over the logarithm of 2, as all exponents here
uniform float focal, spacing, cells, blocks, thickness, min_light;
uniform vec2 contrast;       // softplus times this multiplies density, at most by the gain
flat in vec2 reach;
out vec4 colour;
DECLARED
void main() {
    vec2 pixel = (gl_FragCoord.xy - middle) / focal;
    vec3 along = normalize(right * pixel.x - up * pixel.y - backward);
    along = mix(along, vec3(1e-9), lessThan(abs(along), vec3(1e-9)));
    vec3 lower = (-extent - origin) / along, upper = (extent - origin) / along;
    vec3 low = min(lower, upper), high = max(lower, upper);
    float near = max(0.0, max(low.x, max(low.y, low.z)));
    float far = min(reach.y, min(high.x, min(high.y, high.z)));
    // In the box's coordinates, 0 to 1, the sample i lies at base + i * delta; in cells of the distance, and in the
    // texture, likewise. What does not change along the ray is computed here: nothing moves it out of the loop.
    vec3 base = 0.5 + 0.5 * (origin + along * (near + 0.5 * spacing)) / extent, delta = 0.5 * along * spacing / extent;
    vec3 block_base = base * blocks, block_delta = delta * blocks, samples_per_block = 1.0 / block_delta;
    vec3 forward = sign(along), leave_base = vec3(lessThan(along, vec3(0.0))) - block_base;
    vec3 texel_base = (base * cells - first + 0.5) / sides, texel_delta = delta * cells / sides;
    int last_block = int(blocks) - 1;
    float i = max(0.0, floor((reach.x - near) / spacing)), count = ceil((far - near) / spacing - 0.5);
    vec3 rgb = vec3(0.0);
    float light = 1.0, middle_of_light = 0.0;
    while (i < count && light > min_light) {
        ivec3 block = min(ivec3(block_base + i * block_delta), last_block);
        float empty = float(texelFetch(distance, block.zyx, 0).r);
        // Leave the cube of empty cells around this one. The sample there is taken without asking again whether its
        // cell is empty, for it has nearly no density then: in software both branches of a question cost time.
        vec3 leave = (vec3(block) + empty * forward + leave_base) * samples_per_block;
        i = empty > 0.0 ? max(i, ceil(min(leave.x, min(leave.y, leave.z)))) : i;
        vec4 texel = textureLod(texels, (texel_base + i * texel_delta).zyx, 0.0);
        float softplus = log2(1.0 + exp2(logits.x + logits.y * texel.a));
        softplus *= min(softplus * contrast.x, contrast.y);
        float left = i < count ? light * exp2(-thickness * softplus) : light;
        rgb += (light - left) * texel.rgb;
        middle_of_light += (light - left) * (i + 0.5);
        light = left;
        i += 1.0;
    }
    // The little light that a ray ends with counts as taken.
    float taken = max(1.0 - light, 1e-6), opacity = light > min_light ? 1.0 - light : 1.0;
    rgb *= opacity / taken;
    ADDED
    colour = vec4(clamp(rgb, 0.0, opacity), opacity);
}
"""
_DETAIL = f"""
    if (opacity > {MIN_OPACITY})
        rgb += opacity * detail(origin + along * (near + spacing * middle_of_light / taken), along, rgb / opacity);
"""

_NO_CONTRAST = 1e9, 1.0  # makes the factor reach the gain of 1 for any density


class BakedShader:
    """The program and the textures of one baked field. Its GL context must be current in every call."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._detail = DetailTextures(context)
        self._programs = dict[str, moderngl.Program]()  # by fragment shader
        self._texels: moderngl.Texture3D | None = None
        self._distance = context.texture3d((CELLS,) * 3, 1, dtype="u1")
        self._distance.filter = moderngl.NEAREST, moderngl.NEAREST
        self._baked: BakedField | None = None

    def upload(self, baked: BakedField) -> None:
        """Upload a field to the graphics card; it replaces the previous field."""
        if baked is self._baked:
            return
        sides = baked.texels.shape[2::-1]
        if self._texels is None or self._texels.size != sides:
            if self._texels is not None:
                self._texels.release()
            self._texels = self._context.texture3d(sides, 4)
            self._texels.repeat_x = self._texels.repeat_y = self._texels.repeat_z = False
        if self._baked is None or self._baked.texels is not baked.texels:
            self._texels.write(np.ascontiguousarray(baked.texels))
        if self._baked is None or self._baked.distance is not baked.distance:
            self._distance.write(np.ascontiguousarray(baked.distance))
            self._centres = _occupied_centres(baked)
        self._detail.upload(baked.detail)
        self._baked = baked

    def _program(self, detail: DetailMaps | None) -> moderngl.Program:
        """Return the compiled program. Without photo detail, software OpenGL takes a third less time."""
        source = fragment_source(detail)
        if source not in self._programs:
            program = self._context.program(vertex_shader=VERTEX, fragment_shader=source)
            for unit, name in enumerate(("texels", "distance", *(self._detail.names if detail else ()))):
                program[name] = unit
            self._programs[source] = program
        return self._programs[source]

    def draw(self, camera: Camera, size: tuple[int, int], corner: tuple[int, int] = (0, 0)) -> None:
        """Draw the uploaded field over the current framebuffer, first row topmost, in premultiplied colours.

        Args:
            size: width and height of the framebuffer, px.
            corner: left and top of the framebuffer in the camera's image, px.
        """
        baked = self._baked
        assert baked is not None and self._texels is not None, "upload a field first"
        camera = camera.stretched(baked.proportions)
        middle = tuple(
            side / 2 - first + baked.pixel_offset
            for side, first in zip((camera.width, camera.height), corner, strict=True)
        )
        tiles, grid = _tiles(self._centres, baked, camera, size, corner)
        if not len(tiles):
            return
        program = self._program(baked.detail)
        image = {"tiles": grid, "middle": middle, "focal": camera.focal}
        for name, value in (camera_uniforms(camera) | image | field_uniforms(baked)).items():
            program[name] = value
        self._texels.use(0)
        self._distance.use(1)
        if baked.detail:
            program["strength"] = baked.detail.strength
            self._detail.use(2)
            for name, value in uniforms(baked.detail, camera).items():
                program[name] = value
        buffer = self._context.buffer(tiles.tobytes())
        array = self._context.vertex_array(program, [(buffer, "4f/i", "tile")])
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        array.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(tiles))
        self._context.disable(moderngl.BLEND)
        array.release()
        buffer.release()

    def release(self) -> None:
        """Release the GL objects."""
        self._detail.release()
        for resource in (self._texels, self._distance, *self._programs.values()):
            if resource is not None:
                resource.release()


def field_uniforms(baked: BakedField) -> dict[str, Any]:
    """Return the fragment shader's uniforms that do not depend on the camera."""
    lowest, highest = LOGITS
    config = baked.config
    contrast = _NO_CONTRAST
    if config.contrast:
        contrast = math.log(2) * config.density_scale / config.contrast, config.contrast_gain
    return {
        "extent": baked.extent,
        "first": baked.first,
        "sides": baked.texels.shape[:3],
        "cells": baked.cells,
        "spacing": baked.step,
        "thickness": config.density_scale * baked.step,
        "contrast": contrast,
        "blocks": CELLS,
        "min_light": MIN_LIGHT,
        "logits": (lowest / math.log(2), (highest - lowest) / math.log(2)),
    }


def fragment_source(detail: DetailMaps | None) -> str:
    """Return the fragment shader, with or without photo detail."""
    if detail is None:
        return FRAGMENT.replace("DECLARED", "").replace("ADDED", "")
    return FRAGMENT.replace("DECLARED", glsl(detail.edits)).replace("ADDED", _DETAIL)


def _occupied_centres(baked: BakedField) -> Float32[torch.Tensor, "occupied 3"]:
    """Return the world centres of occupied cells, except interior ones: every ray meets a boundary cell first."""
    occupied = torch.from_numpy(baked.distance == 0)
    # All neighbours of an interior cell are occupied, including those before and after it on a ray.
    inner = -functional.max_pool3d(-functional.pad(occupied[None].float(), (1,) * 6), 3, 1)[0] > 0
    extent = torch.tensor(baked.extent)
    return ((occupied & ~inner).nonzero() + 0.5) * (2 * extent / CELLS) - extent


def _tiles(
    centres: Float32[torch.Tensor, "occupied 3"],
    baked: BakedField,
    camera: Camera,
    size: tuple[int, int],
    corner: tuple[int, int],
) -> tuple[Float32[np.ndarray, "tiles 4"], tuple[int, int]]:
    """Return the tiles that show occupied cells, and the size of the tile grid.

    A tile is its column, its row, and the nearest and the farthest distance of its cells.
    """
    radius = math.hypot(*(side / CELLS for side in baked.extent))
    offset = baked.pixel_offset - corner[0], baked.pixel_offset - corner[1]
    near, far = splat(camera, centres, radius, size, offset)
    row, column = (far > 0).nonzero(as_tuple=True)
    tiles = torch.stack((column, row, near[row, column], far[row, column]), -1)
    return tiles.float().numpy(), (near.shape[1], near.shape[0])
