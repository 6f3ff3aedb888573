"""The parts of an object in an image, with a handle at the outer edge of each: the place to pull it by."""

import math
from collections.abc import Container
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int
from scipy import ndimage
from torch import Tensor

from core.detail.progressive import Frame
from core.editing.paint import frame_points
from core.geometry.camera import Camera
from core.models.model import Instance
from core.models.part_head import ABOVE_SEAT
from core.rendering.folded_field import FoldedField
from core.runtime.layers import pad_rows

Box = tuple[float, float, float, float]  # left, top, right, bottom: fractions of an image's width and height

_SIDE = 128  # px along an image's shorter side at which parts are looked up
_OPAQUE = 0.5  # opacity from which a pixel counts as the object
_BLUR = 0.8  # px over which the parts' probabilities are averaged
_SPECK = 25  # px of the smallest region that stays
_NEXT_TO = 4.0  # px from a larger region within which a small one joins it
_INSIDE = 2.0  # px from a region's edge: nearer to it, the depth is a mixture of surfaces
_CORNER = 0.2  # weight by which the middle of a side is preferred to its corners
_MIDDLE = 0.25  # of the object's width and height, to either side of its middle: a newcomer's first drag begins there


class Handle(NamedTuple):
    """A place of a visible part by which it is pulled."""

    part: str
    place: tuple[float, float]  # fractions of the image's width and height
    point: tuple[float, float, float]  # on the surface, scene units before stretching
    is_outer: bool = True  # outside the middle half of the object in the image


@dataclass(frozen=True, eq=False)
class PartMap:
    """The parts in an image. A part has a handle in each of its connected regions, such as the legs of a chair."""

    handles: tuple[Handle, ...]
    regions: Int[np.ndarray, "rows columns"]  # index of each pixel's handle; -1 on the background

    def handle_at(self, place: tuple[float, float]) -> Handle | None:
        """Return the handle of the region at a place (fractions of width and height); None beside the object."""
        rows, columns = self.regions.shape
        x, y = place
        if not (0 <= x < 1 and 0 <= y < 1):
            return None
        index = int(self.regions[int(y * rows), int(x * columns)])
        return self.handles[index] if index >= 0 else None

    def largest(self, parts: Container[str]) -> str:
        """Return the part with most pixels among some; "" if none of them is visible."""
        visible = {handle.part for handle in self.handles if handle.part in parts}
        return max(sorted(visible), key=lambda part: self.mask(part).sum(), default="")

    def mask(self, part: str) -> Bool[np.ndarray, "rows columns"]:
        """Return the pixels of a part."""
        is_of_part = np.array([handle.part == part for handle in self.handles] + [False])
        return is_of_part[self.regions]


@torch.no_grad()
def part_map(instance: Instance, camera: Camera, frame: Frame, box: Box = (0.0, 0.0, 1.0, 1.0)) -> PartMap:
    """Find the parts in a frame of an object, seen from ``camera``.

    An object without a part head is one part, named by the model's noun. The authors' checkpoints, which paint the
    background, have none.

    Args:
        box: the part of the frame that is on screen.
    """
    step = max(1, min(frame.resolution) // _SIDE)
    opaque = _within(box, frame.opacity[::step, ::step] > _OPAQUE) & (not instance.model.white_from_network)
    points = frame_points(instance, camera, frame, torch.from_numpy(opaque), step)
    head = instance.model.part_head
    names = head.names if head else (instance.model.noun or "object",)
    images = np.zeros((len(names), *opaque.shape), np.float32)
    images[:, opaque] = _probabilities(instance, points).T
    labels = np.where(opaque, ndimage.gaussian_filter(images, (0, _BLUR, _BLUR)).argmax(0), -1)
    regions, parts = _regions(_without_specks(labels), len(names))
    surface = np.zeros((*opaque.shape, 3), np.float32)
    surface[opaque] = points
    handles = tuple(_handle(regions, index, names[part], surface) for index, part in enumerate(parts))
    return PartMap(handles, regions)


def _within(box: Box, mask: Bool[np.ndarray, "rows columns"]) -> Bool[np.ndarray, "rows columns"]:
    """Return a mask without its pixels outside a box."""
    rows, columns = mask.shape
    left, top, right, bottom = box
    x = (np.arange(columns) + 0.5) / columns
    y = (np.arange(rows) + 0.5) / rows
    return mask & ((x > left) & (x < right)) & ((y > top) & (y < bottom))[:, None]


def _probabilities(instance: Instance, points: Float[Tensor, "points 3"]) -> Float[np.ndarray, "points parts"]:
    """Return the probabilities of the parts at surface points, 0 where a part cannot be."""
    head = instance.model.part_head
    if head is None or not len(points):
        return np.ones((len(points), len(head.names) if head else 1), np.float32)
    folded = FoldedField.of(instance)
    features = folded.density(pad_rows(points.to(instance.model.device)))[1][: len(points)]
    probabilities = head(features).cpu()
    if "seat" not in head.names:
        return probabilities.numpy()
    is_seat = probabilities.argmax(1) == head.names.index("seat")
    heights = folded.origins(points)[:, 2]
    above = heights - (heights[is_seat].median() if is_seat.any() else 0.0)
    for index, name in enumerate(head.names if is_seat.any() else ()):
        low, high = ABOVE_SEAT.get(name, (-math.inf, math.inf))
        probabilities[(above < low) | (above > high), index] = 0.0
    return probabilities.numpy()


def _without_specks(labels: Int[np.ndarray, "rows columns"]) -> Int[np.ndarray, "rows columns"]:
    """Merge small regions of one part into those next to them; the others become background."""
    is_kept = np.zeros(labels.shape, bool)
    for part in np.unique(labels[labels >= 0]):
        regions, _ = ndimage.label(labels == part)
        is_kept |= (np.bincount(regions.ravel()) >= _SPECK)[regions] & (labels == part)
    if not is_kept.any():
        return np.full_like(labels, -1)
    distance, nearest = ndimage.distance_transform_edt(~is_kept, return_indices=True)
    return np.where((labels >= 0) & (distance <= _NEXT_TO), labels[tuple(nearest)], -1)


def _regions(labels: Int[np.ndarray, "rows columns"], count: int) -> tuple[Int[np.ndarray, "rows columns"], list[int]]:
    """Return the connected region of each pixel, -1 on the background, and the part of each region."""
    regions = np.full(labels.shape, -1)
    parts = list[int]()
    for part in range(count):
        numbers, region_count = ndimage.label(labels == part)
        regions = np.where(numbers > 0, numbers - 1 + len(parts), regions)
        parts += [part] * region_count
    return regions, parts


def _handle(
    regions: Int[np.ndarray, "rows columns"], index: int, part: str, surface: Float32[np.ndarray, "rows columns 3"]
) -> Handle:
    """Return the handle of a region: within its edge, far from the object's middle and from other regions."""
    rows, columns = regions.shape
    rest = (regions >= 0) & (regions != index)
    apart = ndimage.distance_transform_edt(~rest) if rest.any() else np.zeros(regions.shape)
    depth = ndimage.distance_transform_edt(np.pad(regions == index, 1))[1:-1, 1:-1]
    pixels = np.argwhere(depth >= min(_INSIDE, depth.max()))
    box = np.argwhere(regions >= 0)
    low = box.min(0)
    high = box.max(0) + 1
    away = np.abs(pixels - (low + high) / 2) / (high - low)
    best = (away.max(1) - _CORNER * away.min(1) + apart[tuple(pixels.T)] / (high - low).max()).argmax()
    row, column = pixels[best]
    x, y, z = surface[row, column].tolist()
    place = (float(column) + 0.5) / columns, (float(row) + 0.5) / rows
    return Handle(part, place, (x, y, z), bool(away[best].max() > _MIDDLE))
