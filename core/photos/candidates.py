"""Masks that compete to be an object's cut-out: each maker looks at an image in one way and gives what it finds."""

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image
from scipy.ndimage import binary_dilation, binary_erosion, label

from core.geometry.pixels import bounding_box, widened
from core.photos.grabcut import grabcut
from core.photos.plain_background import PlainBackground, find_background
from core.photos.saliency import predict_saliency

_CORE, _FAINT = 0.9, 0.1
"""opacities above and below which the saliency network has no doubt"""
_HINT = 0.25
"""opacity from which it may have seen a leg: thin things are nothing but edge to it"""
_NETWORK_ERROR = 0.006
"""of what the network looks at: two pixels of its own image, by which its edges may be off"""
_ROOM = 0.15
"""of a box: how much around it the second look sees"""
_CLOSER = 0.8
"""of the image's area: a box that is larger would show the network little new"""
_FAR = 0.12
"""of an object's size: background further from it than this is sure"""
_PART = 0.12
"""of all pieces: from this size on a piece may be the object"""
_WINDOWS = 0.4, 0.75
"""of the image's longer side: what the network looks at around a point"""
_AT_POINT = (0.8, 2), (0.25, 3), (0.03, 1)
"""windows around a point where there is no network, and GrabCut's labels in them"""
_MIDDLE = 0.1
"""of the image on each side that is background where nothing is known"""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A mask that may be the object's."""

    found_by: str
    """how, for people"""
    opacity: Float[np.ndarray, "height width"]
    """0..1"""
    edge_error: float = 0.0
    """px by which the edges may be off"""
    white: bool = False
    """the background is white, as in training images"""
    certain: bool = False
    """beyond doubt: others need not be looked for"""


class Look(NamedTuple):
    """What the saliency network sees."""

    name: str
    salient: Float[np.ndarray, "height width"]
    """0..1"""
    side: float
    """px: the longer side of what it was shown"""


@dataclass(frozen=True, eq=False)
class Seen:
    """An image, and what several makers look at in it."""

    image: Image.Image
    colours: Float[np.ndarray, "height width 3"]
    """0..1"""
    point: tuple[float, float] | None = None
    """shares of width and height: the object is here"""

    @cached_property
    def background(self) -> PlainBackground | None:
        """None where there is no plain one."""
        return find_background(self.colours)

    @cached_property
    def salient(self) -> Float[np.ndarray, "height width"] | None:
        """What the saliency network sees, at the point if there is one; None where it sees nothing there."""
        if self.point is None:
            found = predict_saliency(self.image)
        else:
            looks = [look for share in _WINDOWS if (look := self._at(self.point, share)) is not None]
            found = np.asarray(np.mean(looks, axis=0), np.float32) if looks else None
        return found if found is not None and (found > 0.5).any() else None

    def _at(self, point: tuple[float, float], share: float) -> Float[np.ndarray, "height width"] | None:
        """What it sees in a window of so large a share of the image; None where that does not hold the point."""
        found = self._within(_window(point, share, self.image.size))
        return found if found is not None and _hold(found > 0.5, point) else None

    def _within(self, box: tuple[int, int, int, int], even: bool = False) -> Float[np.ndarray, "height width"] | None:
        """What it sees in a crop."""
        found = predict_saliency(self.image.crop(box), even)
        if found is None:
            return None
        left, top, right, bottom = box
        whole = np.zeros(self.colours.shape[:2], np.float32)
        whole[top:bottom, left:right] = found
        return whole

    @cached_property
    def looks(self) -> list[Look]:
        """All that it sees: also with local contrast evened out, and so in the crop around both."""
        if self.salient is None:
            return []
        looks, side = [Look("network", self.salient, max(self.image.size))], max(self.image.size)
        if self.point is None and (even := predict_saliency(self.image, True)) is not None:
            looks.append(Look("network, contrast evened", even, side))
        left, top, right, bottom = box = _box_around(np.max([look.salient for look in looks], axis=0) > _HINT)
        if (right - left) * (bottom - top) < _CLOSER * self.salient.size:
            closer = self._within(box, even=True)
            if closer is not None:
                looks.append(Look("network, closer", closer, max(right - left, bottom - top)))
        return looks

    @cached_property
    def agreed(self) -> Float[np.ndarray, "height width"] | None:
        """The mean of all looks; None where there is none."""
        return np.asarray(np.mean([look.salient for look in self.looks], axis=0)) if self.looks else None


def by_background(seen: Seen) -> Iterator[Candidate]:
    """What differs from a plain background; if that is in doubt, near what the network sees."""
    plain = seen.background
    if plain is None:
        return
    mask = ~plain.mask
    certain = plain.certain and (seen.point is None or _hold(mask, seen.point))
    if certain or seen.salient is None:
        yield Candidate("plain background", mask.astype(np.float32), white=plain.white, certain=certain)
    else:
        # Colours follow edges more closely than a network of 320 px does, but take shadows for the object.
        near = binary_dilation(seen.salient > _FAINT, iterations=_network_pixels(max(mask.shape)))
        yield Candidate("plain background near the network's object", (mask & near).astype(np.float32))


def by_network(seen: Seen) -> Iterator[Candidate]:
    """The saliency network's answers, and all faint in them too; none that has lost nearly all of the object."""
    most = max((int((look.salient > 0.5).sum()) for look in seen.looks), default=0)
    for name, salient, side in seen.looks:
        if (salient > 0.5).sum() < _PART * most:
            continue
        yield _of_network(name, salient, side)
        yield _of_network(f"{name}, faint too", (salient * (0.5 / _HINT)).clip(0, 1), side)


def by_colours(seen: Seen) -> Iterator[Candidate]:
    """GrabCut, seeded by the network's core and the background far from it; by the point or the middle without one."""
    if seen.salient is None or seen.agreed is None:
        labels = np.zeros(seen.colours.shape[:2], np.uint8)
        for share, label_there in ((1 - 2 * _MIDDLE, 3),) if seen.point is None else _AT_POINT:
            left, top, right, bottom = _window(seen.point or (0.5, 0.5), share, seen.image.size)
            labels[top:bottom, left:right] = label_there
        yield from _by_grabcut("colours in the middle" if seen.point is None else "colours", seen, labels)
        return
    salient = seen.agreed if (seen.agreed > 0.5).any() else seen.salient
    yield from _by_grabcut("colours around the network's core", seen, _seeds(salient))


def by_parts(candidate: Candidate) -> Iterator[Candidate]:
    """The pieces of a mask that has several, the largest first."""
    pieces, _ = label(candidate.opacity > 0.5, np.ones((3, 3)))
    areas = np.bincount(pieces.ravel())
    areas[0] = 0
    large = [number for number in np.argsort(-areas) if areas[number] > _PART * areas.sum()]
    for number in large[:2] if len(large) > 1 else ():
        alone = binary_dilation(pieces == number, iterations=2) & ((pieces == number) | (pieces == 0))
        opacity = np.where(alone, candidate.opacity, 0).astype(np.float32)
        yield Candidate(f"a part of: {candidate.found_by}", opacity, candidate.edge_error)


def by_piece(candidate: Candidate, point: tuple[float, float]) -> Iterator[Candidate]:
    """The piece of a mask that a point lies on, with what nearly touches it."""
    if not _hold(candidate.opacity > 0.5, point):
        return
    near = binary_dilation(candidate.opacity > 0.5, iterations=2)
    pieces, _ = label(near)
    alone = pieces == _value_at(pieces, point)
    yield replace(candidate, opacity=np.where(alone, candidate.opacity, np.float32(0)))


MAKERS: tuple[Callable[[Seen], Iterator[Candidate]], ...] = (by_background, by_network, by_colours)
"""the quick ones first"""


def find_candidates(seen: Seen) -> list[Candidate]:
    """All masks that makers find; one alone where it is beyond doubt."""
    found: list[Candidate] = []
    for maker in MAKERS:
        for candidate in maker(seen):
            if candidate.certain:
                return [candidate]
            found += (candidate, *by_parts(candidate)) if seen.point is None else by_piece(candidate, seen.point)
    return found


def guess(size: tuple[int, int], points: tuple[tuple[float, float], ...]) -> Candidate:
    """An ellipse at the first point, or in the middle: where nothing at all is found."""
    (height, width), (x, y) = size, points[0] if points else (0.5, 0.5)
    down, across = np.ogrid[0.5:height, 0.5:width]
    inside = np.hypot(across / width - x, down / height - y) < 0.5 - 2 * _MIDDLE
    return Candidate("nothing but its place", inside.astype(np.float32))


def _of_network(found_by: str, salient: Float[np.ndarray, "height width"], side: float) -> Candidate:
    """Inside an object the network may be unsure what it sees, but not that there is something."""
    inside = binary_erosion(salient > 0.5, iterations=_network_pixels(side))
    return Candidate(found_by, np.where(inside, np.float32(1), salient), _NETWORK_ERROR * side)


def _network_pixels(side: float) -> int:
    return max(1, round(_NETWORK_ERROR * side))


def _seeds(salient: Float[np.ndarray, "height width"]) -> UInt8[np.ndarray, "height width"]:
    """Labels of GrabCut: 0 and 1 are surely background and object, 2 and 3 probably."""
    left, top, right, bottom = _box_around(salient > 0.5)
    far = max(2, round(_FAR * max(right - left, bottom - top)))
    labels = np.where(salient > 0.5, 3, 2).astype(np.uint8)
    labels[~_dilated(salient > _FAINT, far)] = 0
    labels[binary_erosion(salient > _CORE, iterations=_network_pixels(max(salient.shape)))] = 1
    return labels


def _dilated(mask: Bool[np.ndarray, "height width"], pixels: int) -> Bool[np.ndarray, "height width"]:
    import cv2

    kernel = np.ones((2 * pixels + 1, 2 * pixels + 1), np.uint8)
    return cv2.dilate(mask.astype(np.uint8), kernel).astype(bool)


def _by_grabcut(found_by: str, seen: Seen, labels: UInt8[np.ndarray, "height width"]) -> Iterator[Candidate]:
    possible = labels > 0
    if not possible.any() or not (labels != 1).any():
        return
    with suppress(ValueError):
        mask = grabcut(seen.colours, labels, _box_around(possible))
        if mask.any():
            yield Candidate(found_by, mask.astype(np.float32))


def _value_at(values: np.ndarray, point: tuple[float, float]) -> int:
    height, width = values.shape
    return int(values[min(height - 1, int(point[1] * height)), min(width - 1, int(point[0] * width))])


def _hold(mask: Bool[np.ndarray, "height width"], point: tuple[float, float]) -> bool:
    """Whether a point is in it."""
    return bool(_value_at(mask, point))


def _window(point: tuple[float, float], share: float, size: tuple[int, int]) -> tuple[int, int, int, int]:
    """A box (px) around a point, as far as it is in the image."""
    (x, y), (width, height) = point, size
    half = max(4, share * max(size) / 2)
    left, top = int(max(0, x * width - half)), int(max(0, y * height - half))
    return left, top, int(min(width, math.ceil(x * width + half))), int(min(height, math.ceil(y * height + half)))


def _box_around(mask: Bool[np.ndarray, "height width"]) -> tuple[int, int, int, int]:
    """Left, top, right and bottom (px) of a box around all of it, with room."""
    left, top, right, bottom = box = bounding_box(mask)
    return widened(box, round(_ROOM * max(right - left, bottom - top)), mask.shape)
