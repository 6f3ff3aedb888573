"""Textures: the object on the view's background, from a frame or baked, and small images."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import moderngl
import numpy as np
from imgui_bundle import imgui
from jaxtyping import UInt8

from core.detail.progressive import Frame
from core.gl.background import GLSL
from core.gl.baked_field import BakedField
from core.gl.baked_shader import BakedShader
from core.gl.ground_shader import GroundShader
from core.rendering.ground_shadow import GroundShadow
from viewer.activities.thumbnails import pixels_of
from viewer.screen.theme import Palette, mixed
from viewer.values.orbit import PanelCrop

_SPARE = 2_000_000  # px of unused textures that are kept
_SCREEN = """
#version 330
out vec2 uv;
void main() {
    uv = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    gl_Position = vec4(4.0 * uv - 1.0, 0.0, 1.0);
    uv *= 2.0;
}
"""  # vertex shader of a triangle that covers all pixels
_BACKGROUND = """
#version 330
in vec2 uv;
out vec4 colour;
BACKGROUND
void main() { colour = vec4(background(uv.y), 1.0); }
""".replace("BACKGROUND", GLSL)
_FRAGMENT = """
#version 330
uniform sampler2D image;  // on white; alpha is how much of a pixel the object covers
in vec2 uv;
out vec4 colour;
void main() {
    vec4 pixel = texture(image, uv);
    colour = vec4(pixel.rgb - (1.0 - pixel.a), pixel.a);
}
"""


class Canvas:
    """The object, scaled to the view, with the theme's background, a shadow on the ground, and the ring of photos."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._texture = context.texture((1, 1), 4)  # the last image
        self._framebuffer = context.framebuffer([self._texture])
        self._background = context.program(vertex_shader=_SCREEN, fragment_shader=_BACKGROUND)
        self._background_pass = context.vertex_array(self._background, [])
        self._ground = GroundShader(context)
        self._program = context.program(vertex_shader=_SCREEN, fragment_shader=_FRAGMENT)
        self._pass = context.vertex_array(self._program, [])
        self._image = context.texture((1, 1), 4)  # the last frame
        self._baked = BakedShader(context)
        self._inputs: tuple[Any, ...] = ()  # of the drawn texture

    def draw_baked(
        self, baked: BakedField, crop: PanelCrop, palette: Palette, ring: tuple[float, ...] = ()
    ) -> imgui.ImTextureRef:
        """Return a texture of the crop's size with a baked object, redrawn only after a change.

        Args:
            ring: azimuths of photos, see :class:`core.gl.ground_shader.GroundShader`.
        """
        if (baked, crop, palette, ring) != self._inputs:
            size = crop.width, crop.height
            with self._drawing(size):
                self._fill(palette)
                self._cast(baked.shadow, crop, ring)
                self._baked.upload(baked)
                self._baked.draw(crop.camera, size, (crop.left, crop.top))
            self._inputs = baked, crop, palette, ring
        return imgui.ImTextureRef(self._texture.glo)

    def draw(
        self,
        frame: Frame,
        crop: PanelCrop,
        size: tuple[int, int],
        palette: Palette,
        shadow: bool,
        ring: tuple[float, ...] = (),
    ) -> imgui.ImTextureRef:
        """Return a texture with a frame in its crop's proportions, redrawn only after a change.

        Args:
            size: width and height of the texture, px.
            shadow: draw the frame's shadow on the ground, if the frame has one.
            ring: azimuths of photos, see :meth:`draw_baked`.
        """
        inputs = (frame, crop, size, palette, shadow, ring)
        if inputs != self._inputs:
            self._upload(frame)
            with self._drawing(size):
                self._fill(palette)
                self._context.viewport = within(size, (crop.width, crop.height))
                self._cast(frame.shadow if shadow else None, crop, ring)
                self._draw_image()
            self._inputs = inputs
        return imgui.ImTextureRef(self._texture.glo)

    def pixels(self) -> UInt8[np.ndarray, "height width 3"]:
        """Return the last image; call after :meth:`draw` or :meth:`draw_baked`."""
        return np.frombuffer(self._texture.read(), np.uint8).reshape(*self._texture.size[::-1], 4)[..., :3]

    def release(self) -> None:
        """Release the GL objects."""
        background = self._background_pass, self._background, self._ground
        target = self._framebuffer, self._texture
        for resource in (*target, self._image, self._pass, self._program, self._baked, *background):
            resource.release()

    @contextmanager
    def _drawing(self, size: tuple[int, int]) -> Iterator[None]:
        """Bind the texture, resized to ``size`` (px), as the framebuffer inside a ``with``."""
        screen = self._context.screen  # None without a window
        previous = screen and (self._context.fbo or screen)
        if self._texture.size != size:
            self._framebuffer.release()
            self._texture.release()
            self._texture = self._context.texture(size, 4)
            self._framebuffer = self._context.framebuffer([self._texture])
        self._framebuffer.use()
        self._context.viewport = (0, 0, *size)
        # ImGui leaves its own state behind, blending and scissors included.
        self._context.disable(moderngl.BLEND | moderngl.CULL_FACE | moderngl.DEPTH_TEST)
        self._context.scissor = None
        yield
        if previous:
            previous.use()

    def _fill(self, palette: Palette) -> None:
        """Fill the current framebuffer with the theme's background."""
        self._background["top"], self._background["bottom"] = palette.background
        self._background_pass.render(moderngl.TRIANGLES, vertices=3)

    def _cast(self, shadow: GroundShadow | None, crop: PanelCrop, ring: tuple[float, ...]) -> None:
        """Draw the shadow of a crop, if any, with the ring of photos, on the ground within the current viewport."""
        if shadow:
            self._ground.draw(shadow, crop.camera, (crop.width, crop.height), (crop.left, crop.top), ring)

    def _upload(self, frame: Frame) -> None:
        if self._image.size != frame.resolution:
            self._image.release()
            self._image = self._context.texture(frame.resolution, 4)
            self._image.repeat_x = self._image.repeat_y = False
        self._image.write(pixels_of(frame).tobytes())

    def _draw_image(self) -> None:
        self._image.use(0)
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        self._pass.render(moderngl.TRIANGLES, vertices=3)
        self._context.disable(moderngl.BLEND)


def within(size: tuple[int, int], shape: tuple[int, int]) -> tuple[int, int, int, int]:
    """Return left, bottom, width, height (px) of the largest centred rectangle with a shape's proportions.

    Example:
        >>> within((400, 200), (100, 100)), within((64, 48), (32, 24))
        ((100, 0, 200, 200), (0, 0, 64, 48))
    """
    scale = min(side / length for side, length in zip(size, shape, strict=True))
    width, height = (min(side, round(scale * length)) for side, length in zip(size, shape, strict=True))
    return (size[0] - width) // 2, (size[1] - height) // 2, width, height


class Images:
    """Textures of small images, each uploaded once; :meth:`sweep` releases unused ones."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._textures: dict[tuple[int, int], tuple[object, moderngl.Texture]] = {}
        self._used: set[tuple[int, int]] = set()

    def texture(self, image: Frame | np.ndarray, palette: Palette) -> imgui.ImTextureRef:
        """Return the texture of a frame on the theme's background, or of uint8 RGB or RGBA pixels."""
        key = id(image), id(palette)
        self._used.add(key)
        if key not in self._textures:
            pixels = over_background(image, palette) if isinstance(image, Frame) else image
            rgba = np.dstack((pixels, np.full(pixels.shape[:2], 255, np.uint8)))[..., :4]
            # The image is kept alive, so that its id stays unique.
            self._textures[key] = image, self._context.texture(rgba.shape[1::-1], 4, rgba.tobytes())
        return imgui.ImTextureRef(self._textures[key][1].glo)

    def sweep(self) -> None:
        """Release unused textures once there are many; call once a frame."""
        idle = set(self._textures) - self._used
        if sum(math.prod(self._textures[key][1].size) for key in idle) > _SPARE:
            for key in idle:
                self._textures.pop(key)[1].release()
        self._used.clear()

    def release(self) -> None:
        """Release all textures."""
        for _, texture in self._textures.values():
            texture.release()
        self._textures.clear()


def over_background(frame: Frame, palette: Palette) -> np.ndarray:
    """Return a frame as uint8 RGB over a colour from the middle of the theme's background."""
    background = np.array(mixed(*palette.background, 0.35))
    left = (1 - frame.opacity.clip(0, 1))[..., None]
    return (frame.image - 255 * left * (1 - background) + 0.5).clip(0, 255).astype(np.uint8)
