"""The speed of OpenGL: whether it draws a baked object (:mod:`core.gl.baked_shader`) as fast as it is turned."""

import math
import time

import moderngl
import numpy as np

from core.geometry.camera import Camera
from core.gl.baked_field import BakedField
from core.models.field_config import FieldConfig
from core.rendering.occupancy import CELLS
from viewer.screen.canvas import Canvas
from viewer.screen.theme import DARK
from viewer.values.orbit import PanelCrop

_FAST = 1 / 30  # s: OpenGL is fast if it draws a test image in this time
_PROBE = 512  # px, side of a test image
_PROBES = 3  # test images, of which one must be fast
_FAR = 4  # factor over the limit that other programs' load cannot explain


def is_fast(context: moderngl.Context, limit: float = _FAST) -> bool:
    """True if OpenGL draws a baked ball of 512 px within ``limit`` seconds.

    One fast image of a few suffices, as other programs take time; two far slower images end the test.
    """
    canvas = Canvas(context)
    baked = _ball()
    fastest = math.inf
    for number in range(_PROBES + 1):
        crop = PanelCrop(Camera(0.1 * number, 0.3, 2.0, 1.5 * _PROBE, _PROBE, _PROBE), _PROBE, _PROBE)
        context.finish()
        began = time.perf_counter()
        canvas.draw_baked(baked, crop, DARK)
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
