"""The cameras of ShapeNet-SRN: random ones for training, a spiral for testing."""

import math
import zlib

import numpy as np

from core.geometry.camera import Camera
from core.lab.datasets.categories import Split, category_sizes

SRN_FOCAL = 131.25  # px, at SRN's 128 px images
SRN_SIZE = 128
SPIRAL_VIEWS = 251
_SPIRAL_TURN = 150.0  # rad of azimuth from the horizon to the pole: 0.6 a step, about 24 turns


def split_cameras(split: Split, count: int, name: str, category: str, size: int) -> tuple[Camera, ...]:
    """Return the cameras of a split. Training views depend only on the object's name."""
    distance = category_sizes(category).distance
    if split != "train":
        return spiral_views(count, distance, size)
    return training_views(count, np.random.default_rng(zlib.crc32(name.encode())), distance, size)


def training_views(
    count: int, generator: np.random.Generator, distance: float, size: int = SRN_SIZE
) -> tuple[Camera, ...]:
    """Return random directions, uniform over each half of the sphere; three in four (rounded) above the horizon."""
    heights = generator.random(count)
    below = generator.permutation(count) >= round(0.75 * count)
    azimuths = generator.uniform(-math.pi, math.pi, count)
    elevations = np.arcsin(np.where(below, -heights, heights))
    return tuple(_camera(a, e, distance, size) for a, e in zip(azimuths, elevations, strict=True))


def spiral_views(count: int, distance: float, size: int = SRN_SIZE) -> tuple[Camera, ...]:
    """Return SRN's test cameras, originally ``SPIRAL_VIEWS``: evenly along a spiral from the horizon to the pole."""
    fraction = np.linspace(0.0, 1.0, count)
    return tuple(_camera(-_SPIRAL_TURN * (1 + t), 0.5 * math.pi * t, distance, size) for t in fraction)


def _camera(azimuth: float, elevation: float, distance: float, size: int) -> Camera:
    """Return a camera with SRN's field of view at another size; the azimuth within (-pi, pi]."""
    turned = math.remainder(float(azimuth), 2 * math.pi)
    return Camera(turned, float(elevation), distance, SRN_FOCAL * size / SRN_SIZE, size, size)
