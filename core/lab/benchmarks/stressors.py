"""Stressors: ways in which an image can be worse than the training images.

Every one corrupts an image at some levels, or moves the camera that renders it. To add one, add a line to
:data:`STRESSORS`.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from PIL import Image
from scipy.ndimage import binary_dilation, binary_erosion, gaussian_filter

from core.geometry.camera import FRONT_AZIMUTH, Camera

Cutout = Float[np.ndarray, "height width 4"]  # 0..1: colours on white, and alpha


class Stressor(NamedTuple):
    """One way in which an image can be worse."""

    unit: str  # of the levels
    levels: tuple[float, ...]
    corrupt: Callable[[Cutout, float, np.random.Generator], np.ndarray] = lambda cutout, *_: cutout
    """returns an image with 3 or 4 channels"""
    camera: Callable[[Camera, float], Camera] = lambda camera, _: camera  # of the render
    other_category: bool = False  # it shows an object of another shipped category, to be refused or doubted


def _hide(cutout: Cutout, least: float, generator: np.random.Generator) -> np.ndarray:
    """Hide a fraction ``least`` to ``least`` + 0.2 of the object by discs; the cut-out shows the rest."""
    height, width = cutout.shape[:2]
    visible = cutout[..., 3] > 0.5
    area = visible.sum()
    target = least + 0.2 * generator.random()
    rows, columns = np.nonzero(visible)
    y, x = np.mgrid[:height, :width]
    largest_radius = 0.3 * math.sqrt(area)
    while (hidden := 1 - visible.sum() / area) < target - 0.02:
        centre = generator.integers(len(rows))
        # The last disc has the missing area.
        radius = min(largest_radius, math.sqrt((target - hidden) * area / math.pi) + 1)
        visible &= (y - rows[centre]) ** 2 + (x - columns[centre]) ** 2 > radius**2
    corrupted = cutout.copy()
    corrupted[~visible] = (1, 1, 1, 0)
    return corrupted


def _shift(cutout: Cutout, fraction: float, _: np.random.Generator) -> np.ndarray:
    """Move the object right and down by a fraction of the image."""
    side = round((1 - fraction) * len(cutout))
    shifted = np.zeros_like(cutout)
    shifted[..., :3] = 1
    shifted[-side:, -side:] = cutout[:side, :side]
    return shifted


def _blur(cutout: Cutout, pixels: float, _: np.random.Generator) -> np.ndarray:
    return gaussian_filter(cutout, (pixels, pixels, 0), mode="nearest")


def _downsample(cutout: Cutout, side: float, _: np.random.Generator) -> np.ndarray:
    image = Image.fromarray((cutout * 255 + 0.5).astype(np.uint8), "RGBA")
    return np.asarray(image.resize((int(side), int(side)), Image.Resampling.BOX))


def _corrupt_mask(cutout: Cutout, pixels: float, _: np.random.Generator) -> np.ndarray:
    """Erode the mask (negative) or dilate it; the image stays."""
    mask = (binary_dilation if pixels > 0 else binary_erosion)(cutout[..., 3] > 0.5, iterations=round(abs(pixels)))
    colours = np.where(mask[..., None], cutout[..., :3], 1)
    return np.concatenate((colours, mask[..., None].astype(np.float32)), -1)


def _remove_mask(cutout: Cutout, grey: float, _: np.random.Generator) -> np.ndarray:
    """Put the object on a plain background without alpha channel."""
    return np.where(cutout[..., 3:] > 0.5, cutout[..., :3], np.float32(grey))


def _crop(cutout: Cutout, fraction: float, _: np.random.Generator) -> np.ndarray:
    """Cut off the left part of the object."""
    columns = (cutout[..., 3] > 0.5).sum(0).cumsum()
    return cutout[:, columns > fraction * columns[-1]]


STRESSORS = {
    "none": Stressor("", (0.0,)),
    "frontal": Stressor(
        "degrees from the front",
        (0.0, 180.0),
        camera=lambda camera, level: replace(
            camera, azimuth=FRONT_AZIMUTH + math.radians(level), elevation=math.radians(5)
        ),
    ),
    "hidden": Stressor("of the object at least, at most 0.2 more", (0.2, 0.4, 0.6), _hide),
    "cropping": Stressor("of the object", (0.1, 0.3), _crop),
    "off-centre": Stressor("of the image", (0.1, 0.3), _shift),
    "image size": Stressor("px", (64.0, 32.0, 16.0), _downsample),
    "blur": Stressor("px", (1.0, 3.0), _blur),
    "mask": Stressor("px too wide", (-4.0, -2.0, 2.0, 4.0), _corrupt_mask),
    "no mask": Stressor("grey level", (1.0, 0.5), _remove_mask),
    "another category": Stressor("", (0.0,), other_category=True),
}  # by name; every object is tried with every level of each
