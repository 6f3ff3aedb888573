"""A baked object drawn by OpenGL (:mod:`core.gl.baked_shader`) on the view's background."""

import math
import time
from typing import Any

import moderngl
import numpy as np
from imgui_bundle import imgui
from jaxtyping import UInt8

from core.geometry.camera import Camera
from core.gl.baked_field import BakedField
from core.gl.baked_shader import BakedShader
from core.models.field_config import FieldConfig
from core.rendering.occupancy import CELLS
from viewer.screen.canvas import Backdrop, Target
from viewer.screen.theme import DARK, Palette
from viewer.values.orbit import PanelCrop

_FAST = 1 / 30  # s: OpenGL is fast if it draws a test image in this time
_PROBE = 512  # px, side of a test image
_PROBES = 3  # test images, of which one must be fast
_FAR = 4  # factor over the limit that other programs' load cannot explain


class BakedCanvas:
    """Draws an object from any camera at every pixel of the view, on the view's background."""

    def __init__(self, context: moderngl.Context) -> None:
        self._target = Target(context)
        self._backdrop = Backdrop(context)
        self._shader = BakedShader(context)
        self._inputs: tuple[Any, ...] = ()  # of the drawn texture

    def draw(
        self, baked: BakedField, crop: PanelCrop, palette: Palette, ring: tuple[float, ...] = ()
    ) -> imgui.ImTextureRef:
        """Return a texture of the crop's size, with the ring of photos, redrawn only after a change."""
        if (baked, crop, palette, ring) != self._inputs:
            size = crop.width, crop.height
            with self._target.of_size(size):
                self._backdrop.draw(palette, baked.shadow, crop, ring)
                self._shader.upload(baked)
                self._shader.draw(crop.camera, size, (crop.left, crop.top))
            self._inputs = baked, crop, palette, ring
        return imgui.ImTextureRef(self._target.texture.glo)

    def pixels(self) -> UInt8[np.ndarray, "height width 3"]:
        """Return the last image; call after :meth:`draw`."""
        texture = self._target.texture
        return np.frombuffer(texture.read(), np.uint8).reshape(*texture.size[::-1], 4)[..., :3]

    def release(self) -> None:
        """Release the GL objects."""
        self._target.release()
        self._shader.release()
        self._backdrop.release()


def is_fast(context: moderngl.Context, limit: float = _FAST) -> bool:
    """True if OpenGL draws a baked ball of 512 px within ``limit`` seconds.

    One fast image of a few suffices, as other programs take time; two far slower images end the test.
    """
    canvas = BakedCanvas(context)
    baked = _ball()
    fastest = math.inf
    for number in range(_PROBES + 1):
        crop = PanelCrop(Camera(0.1 * number, 0.3, 2.0, 1.5 * _PROBE, _PROBE, _PROBE), _PROBE, _PROBE)
        context.finish()
        began = time.perf_counter()
        canvas.draw(baked, crop, DARK)
        context.finish()
        seconds = time.perf_counter() - began
        if number:  # the first one uploads and compiles
            fastest = min(fastest, seconds)
        if fastest <= limit or (number > 1 and fastest > _FAR * limit):
            break
    canvas.release()
    return fastest <= limit


def _ball() -> BakedField:
    """Return a soft ball, in which rays pass many samples."""
    axis = np.linspace(-1, 1, 2 * CELLS + 1, dtype=np.float32)
    radius = np.sqrt(axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2)
    texels = np.full((*radius.shape, 4), 128, np.uint8)
    texels[..., 3] = np.clip(200 * (1.2 - radius), 0, 70)
    return BakedField(texels, np.zeros((CELLS,) * 3, np.uint8), (0.5, 0.5, 0.5), FieldConfig(), 0.0, 2 * CELLS)
