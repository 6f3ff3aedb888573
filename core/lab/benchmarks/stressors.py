"""Stressors: ways in which the input of a fit can be wrong, each at some levels.

To add one, add a line to :data:`STRESSORS`.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_dilation, gaussian_filter

Cutout = Float[np.ndarray, "height width 4"]  # 0..1: colours on white, and alpha
Corruption = Callable[[Cutout, float, np.random.Generator], Cutout]


class Stressor(NamedTuple):
    """One way in which the input can be wrong."""

    title: str
    unit: str  # of the levels
    levels: tuple[float, ...]
    corrupt: Corruption = lambda cutout, *_: cutout
    harmless: float = 0.0  # level at which nothing is wrong
    focal: bool = False  # the level is the stated focal length over the true one
    stranger: bool = False  # the image shows an object of another category, to be refused or doubted
    intruders: int = 0  # photos of another object among three


def _discs(cutout: Cutout, fraction: float, generator: np.random.Generator, radius: float) -> Cutout:
    """Remove a fraction of the object by discs, whose radius is relative to the square root of the object's area."""
    height, width = cutout.shape[:2]
    visible = _mask(cutout)
    area = visible.sum()
    rows, columns = np.nonzero(visible)
    y, x = np.mgrid[:height, :width]
    while (hidden := 1 - visible.sum() / area) < fraction - 0.02:
        centre = generator.integers(len(rows))
        # The last disc has the missing area.
        largest = min(radius * math.sqrt(area), math.sqrt((fraction - hidden) * area / math.pi) + 1)
        visible &= (y - rows[centre]) ** 2 + (x - columns[centre]) ** 2 > largest**2
    return _masked(cutout, visible)


def _mask(cutout: Cutout) -> Bool[np.ndarray, "height width"]:
    return cutout[..., 3] > 0.5


def _span(visible: Bool[np.ndarray, "height width"], axis: int) -> tuple[int, int]:
    """Return the first visible row (axis 1) or column (axis 0), and the end of the last."""
    lines = np.nonzero(visible.any(axis))[0]
    return lines[0], lines[-1] + 1


def _masked(cutout: Cutout, visible: Bool[np.ndarray, "height width"]) -> Cutout:
    masked = cutout.copy()
    masked[~visible] = (1, 1, 1, 0)
    return masked


def _truncate(cutout: Cutout, fraction: float, _: np.random.Generator) -> Cutout:
    """Cut off the left part of the object, with the image."""
    columns = _mask(cutout).sum(0).cumsum()
    return cutout[:, columns > fraction * columns[-1]]


def _cut_legs(cutout: Cutout, fraction: float, _: np.random.Generator) -> Cutout:
    """Leave the lowest part of the object's height out of the mask."""
    visible = _mask(cutout)
    top, bottom = _span(visible, 1)
    visible[round(bottom - fraction * (bottom - top)) :] = False
    return _masked(cutout, visible)


def _blur(cutout: Cutout, pixels: float, _: np.random.Generator) -> Cutout:
    return gaussian_filter(cutout, (pixels, pixels, 0), mode="nearest")


def _add_noise(cutout: Cutout, deviation: float, generator: np.random.Generator) -> Cutout:
    noisy = cutout.copy()
    noisy[..., :3] += deviation * generator.standard_normal(noisy[..., :3].shape).astype(np.float32)
    return _on_white(noisy)


def _expose(cutout: Cutout, stops: float, _: np.random.Generator) -> Cutout:
    """Multiply linear light by a power of two."""
    exposed = cutout.copy()
    exposed[..., :3] *= 2 ** (stops / 2.2)
    return _on_white(exposed)


def _on_white(cutout: Cutout) -> Cutout:
    """Return valid colours, white where nothing is opaque."""
    clipped = cutout.clip(0, 1)
    clipped[..., :3] = np.where(cutout[..., 3:] > 0, clipped[..., :3], 1)
    return clipped


def _dilate(cutout: Cutout, pixels: float, _: np.random.Generator) -> Cutout:
    """Let the mask take some background."""
    dilated = cutout.copy()
    dilated[..., 3] = binary_dilation(_mask(cutout), iterations=round(pixels))
    return dilated


def _join(cutout: Cutout, fraction: float, _: np.random.Generator) -> Cutout:
    """Join a neighbour to the object: its mirror image beside it, of which a fraction of the width is in the mask."""
    left, right = _span(_mask(cutout), 0)
    joined = round(fraction * (right - left))
    neighbour = cutout[:, left:right][:, ::-1][:, :joined]
    padded = np.pad(cutout, ((0, 0), (0, joined), (0, 0)), constant_values=1)
    padded[:, cutout.shape[1] :, 3] = 0
    space = padded[:, right : right + joined]
    space[_mask(neighbour)] = neighbour[_mask(neighbour)]
    margin = joined // 2  # the image stays a square around both
    return padded[:, margin : margin + cutout.shape[1]]


STRESSORS = {
    "occlusion": Stressor("Hidden by something", "of the object", (0.2, 0.4, 0.6), partial(_discs, radius=0.3)),
    "truncation": Stressor("Truncated by the image", "of the object", (0.1, 0.2, 0.3), _truncate),
    "blur": Stressor("Blur", "px", (1.0, 2.0, 4.0), _blur),
    "noise": Stressor("Noise", "of white", (0.05, 0.1, 0.2), _add_noise),
    "exposure": Stressor("Exposure", "EV", (-2.0, -1.0, 1.0), _expose),
    "holes": Stressor("Holes in the mask", "of the object", (0.1, 0.3), partial(_discs, radius=0.06)),
    "dilated": Stressor("Mask too wide", "px", (2.0, 4.0), _dilate),
    "legs": Stressor("Mask without legs", "of the height", (0.1, 0.2), _cut_legs),
    "neighbour": Stressor("Neighbour in the mask", "of its width", (0.2, 0.4), _join),
    "focal": Stressor("Focal length stated", "of the true one", (0.5, 0.75, 1.5), harmless=1.0, focal=True),
    "stranger": Stressor("Another category", "", (1.0,), stranger=True),
    "intruder": Stressor("Wrong photo among three", "", (1.0,), intruders=1),
}  # every object is tried with every level of each
