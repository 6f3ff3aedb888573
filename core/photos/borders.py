"""Frames around a photo in its file: black borders, bars that fill a format, rounded corners."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import distance_transform_edt

_SAME = 0.16  # of 1: smaller channel differences, as JPEG causes, count as one colour
_DARK = 0.1  # of 1: largest channel of a black frame
_EDGE = 0.75
"""fraction of a photo's edge that must differ from the frame; an object on black reaches its box only in parts"""
_BAR_EDGE = 0.95
"""the same for bars of any colour, since straight furniture on a plain background resembles a photo between bars"""
_SLIVER = 0.03  # largest fraction of an image cut off by rounded corners
_UNIFORM = 0.99  # fraction of a line that must have the frame's colour
_RINGING = 3  # px beside a frame that may be skipped, as JPEG mixes colours there
_MIN_SHARE = 0.5  # least fraction of width and height inside a frame; a smaller box may be an object


class Box(NamedTuple):
    """A part of an image, px; right and bottom are exclusive."""

    left: int
    top: int
    right: int
    bottom: int


def find_frame(colours: Float[np.ndarray, "height width 3"]) -> Box | None:
    """Find the photo within a black frame or between two bars of one colour; None without frame.

    Args:
        colours: 0..1.
    """
    for border in (colours[0], colours[-1], colours[:, 0], colours[:, -1]):
        frame = np.median(border, axis=0)
        if (np.abs(border - frame) < _SAME).all(-1).mean() > _UNIFORM and (box := _within(colours, frame)):
            return box
    return None


def _within(colours: Float[np.ndarray, "height width 3"], frame: Float[np.ndarray, "3"]) -> Box | None:
    """Find the photo in a frame of this colour."""
    same = (np.abs(colours - frame) < _SAME).all(-1)
    rows, columns = (np.flatnonzero(same.mean(axis) < _UNIFORM) for axis in (1, 0))
    if not len(rows) or not len(columns):
        return None
    height, width = same.shape
    box = Box(int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)
    bars = box.left > 0, box.top > 0, box.right < width, box.bottom < height
    two_bars = bars in ((True, False, True, False), (False, True, False, True))
    least = _EDGE if frame.max() < _DARK else _BAR_EDGE
    if not any(bars) or not (frame.max() < _DARK or two_bars):
        return None
    return _to_edges(same, box, bars, least)


def _to_edges(
    same: Bool[np.ndarray, "height width"], box: Box, bars: tuple[bool, bool, bool, bool], least: float
) -> Box | None:
    """Shrink the box past JPEG artefacts until its edges beside bars differ from the frame."""
    height, width = same.shape
    for inset in range(min(_RINGING, round(0.015 * min(height, width))) + 1):
        inner = Box(*(side + step * inset * bar for side, step, bar in zip(box, (1, 1, -1, -1), bars, strict=True)))
        if inner.right - inner.left < _MIN_SHARE * width or inner.bottom - inner.top < _MIN_SHARE * height:
            return None
        inside = same[inner.top : inner.bottom, inner.left : inner.right]
        edges = inside[:, 0], inside[0], inside[:, -1], inside[-1]
        if all(1 - edge.mean() > least for edge, bar in zip(edges, bars, strict=True) if bar):
            return inner
    return None


def is_sliver(clear: Bool[np.ndarray, "height width"]) -> bool:
    """True if so little of an image is transparent that it has rounded corners, not a cut-out."""
    border = np.concatenate((clear[0], clear[-1], clear[:, 0], clear[:, -1]))
    return bool(clear.mean() < _SLIVER and border.mean() < 0.5)


def fill(
    colours: Float[np.ndarray, "height width 3"], clear: Bool[np.ndarray, "height width"]
) -> Float[np.ndarray, "height width 3"]:
    """Fill transparent pixels with the nearest colour."""
    rows, columns = distance_transform_edt(clear, return_distances=False, return_indices=True)
    return colours[rows, columns]
