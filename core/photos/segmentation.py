"""Segmentation: the object of an image, by the likeliest of several masks and by what a person points at."""

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image
from scipy.ndimage import binary_dilation, binary_erosion, distance_transform_edt, label, minimum

from core.geometry.pixels import bounding_box, widened
from core.photos.candidates import Candidate, Seen, guess
from core.photos.decode import NOTE, lens_focal
from core.photos.frames import Box, fill, find_frame, is_sliver
from core.photos.grabcut import grabcut
from core.photos.mask_score import rank_candidates
from core.photos.plain_background import NoBackgroundError

MIN_SIDE = 8
"""px: an image with a shorter side than this shows nothing to fit."""
_MIN_OBJECT_PIXELS = 12
"""px of an object: with fewer it shows nothing to fit."""
_MARGIN = 0.25
"""of a box: so much around it is used to learn the background's colours"""
_PIECE, _SPECK = 0.2, 0.01
"""of the largest piece: pieces that are kept wherever they are, and those that are kept near it"""
_NEAR = 0.1
"""of its size"""
_FAINT = 0.1
"""Between this opacity and 1 less this, nothing is decided."""
_SAME = 0.97
"""intersection over union from which two masks are one"""
_OTHERS = 2
"""masks that are offered beside the best"""
_THRESHOLD = 0.5
"""opacity from which a pixel belongs to the object"""
_REACH = 2.0
"""Radii from a stroke up to which it changes what was found: who wipes a shadow away wants to keep the wheels."""


@dataclass(frozen=True, eq=False)
class CutOut:
    """An image at the size it was cut out."""

    pixels: Float[np.ndarray, "height width 3"]
    """0..1, on white"""
    mask: Bool[np.ndarray, "height width"]
    white: bool
    """the background was white or clear, as in training images"""
    opacity: Float[np.ndarray, "height width"]
    """0..1, of the object; the mask is where it is more than the threshold, a half unless hints say so"""
    edge_error: float = 0.0
    """px by which the edges may be off"""
    undecided: float = 0.0
    """the share of the object's area where what found it saw neither object nor background"""
    found_by: str = ""
    confidence: float = 1.0
    """the probability that the mask is the object, the whole of it and little else"""
    others: tuple["CutOut", ...] = ()
    """the next masks, the likeliest first"""
    focal: float | None = None
    """px, where the image tells"""
    note: str = ""  # which of several readings of the file was used


class Stroke(NamedTuple):
    """A line drawn over an image: what is under it belongs to the object, or does not."""

    points: tuple[tuple[float, float], ...]
    """shares of the image's width and height"""
    radius: float
    """a share of the longer side"""
    adds: bool


@dataclass(frozen=True)
class Hints:
    """Hints from a person. Raises ``ValueError`` for a box without an inside."""

    box: tuple[float, float, float, float] | None = None
    """left, top, right, bottom in shares of width and height; the object is inside. None: where it is is known"""
    strokes: tuple[Stroke, ...] = ()
    threshold: float = _THRESHOLD
    """opacity, 0..1, from which a pixel belongs to an object that the alpha channel or the saliency network finds"""
    points: tuple[tuple[float, float], ...] = ()
    """shares of width and height: on each of them is the object, or a part of it"""
    choice: int = 0
    """which of the masks that are found: 0 is the likeliest"""

    def __post_init__(self) -> None:
        if self.choice < 0 or not all(0 <= share <= 1 for point in self.points for share in point):
            raise ValueError("there is no such mask, or a point is outside the image")
        if not 0 < self.threshold < 1:
            raise ValueError("the threshold of a cut-out is between 0 and 1")
        if self.box is not None:
            left, top, right, bottom = self.box
            if not (0 <= left < right <= 1 and 0 <= top < bottom <= 1):
                raise ValueError("the box around the object has no inside within the image")

    @property
    def pointed(self) -> bool:
        """Whether there is a box, a point or a stroke."""
        return self.box is not None or bool(self.points) or bool(self.strokes)

    def __bool__(self) -> bool:
        return self != Hints()


def cut_out(image: Image.Image, hints: Hints | None = None) -> CutOut:
    """The object of an RGBA image.

    With a box by GrabCut (Rother et al. 2004, of OpenCV). Else by the alpha channel, or else by the likeliest of the
    masks that several ways find (:mod:`core.photos.candidates`, :mod:`core.photos.mask_score`), of those at the points
    where there are some; how sure that is, and which come next, it says too. Strokes correct any of these.

    Raises ``ValueError`` where there is nothing to be found: an image of one colour, or hints that leave nothing.
    """
    if min(image.size) < MIN_SIDE:
        raise ValueError(f"an image of {image.width}x{image.height} px is too small; {MIN_SIDE} px are the least")
    return replace(_cut_out(image, hints), focal=lens_focal(image), note=image.info.get(NOTE, ""))


def _cut_out(image: Image.Image, hints: Hints | None) -> CutOut:
    values = np.asarray(image, dtype=np.float32) / 255
    colours, alpha = values[..., :3], values[..., 3:]
    if hints and hints.pointed:
        colours = colours * alpha + 1 - alpha
        return _segment_with_hints(image, colours, hints)
    return _segment_without_hints(image, colours, alpha, hints or Hints())


def _segment_without_hints(
    image: Image.Image,
    colours: Float[np.ndarray, "height width 3"],
    alpha: Float[np.ndarray, "height width 1"],
    hints: Hints,
) -> CutOut:
    clear = alpha[..., 0] < 0.5
    if clear.any() and is_sliver(clear):
        colours = fill(colours, clear)
    elif clear.mean() > 0.001:
        opaque = Candidate("alpha channel", alpha[..., 0], white=True, certain=True)
        return _on_white(colours * alpha + 1 - alpha, opaque, hints.threshold)
    if box := find_frame(colours):
        return _within(box, image, colours, hints)
    seen = Seen(image, colours)
    if seen.background is not None and seen.background.mask.all():
        raise ValueError("no object found: nothing differs from the background")
    return _best(colours, rank_candidates(seen), hints)


def _best(colours: Float[np.ndarray, "height width 3"], ranked: list[tuple[Candidate, float]], hints: Hints) -> CutOut:
    """The chosen mask, and those that come next."""
    cuts: list[CutOut] = []
    for candidate, confidence in ranked:
        with suppress(ValueError):  # the whole image, or next to nothing
            cut = _on_white(colours, candidate, hints.threshold, confidence)
            if all(_overlap(cut.mask, other.mask) < _SAME for other in cuts):
                cuts.append(cut)
        if len(cuts) > _OTHERS:
            break
    if not cuts:
        cuts = [_on_white(colours, guess(colours.shape[:2], hints.points), confidence=0.0)]
    chosen = cuts.pop(min(hints.choice, len(cuts) - 1))
    return replace(chosen, others=tuple(cuts))


def _within(box: Box, image: Image.Image, colours: Float[np.ndarray, "height width 3"], hints: Hints) -> CutOut:
    """The opacity of the object found in a part of the image; beyond is background."""
    part = colours[box.top : box.bottom, box.left : box.right]
    found = _segment_without_hints(image.crop(box), part, np.ones((*part.shape[:2], 1), np.float32), hints)
    height, width = colours.shape[:2]
    around = (box.top, height - box.bottom), (box.left, width - box.right)

    def padded(cut: CutOut) -> CutOut:
        pixels = np.pad(cut.pixels, (*around, (0, 0)), constant_values=1)
        mask, opacity = np.pad(cut.mask, around), np.pad(cut.opacity, around)
        return replace(cut, pixels=pixels, mask=mask, opacity=opacity, white=False)

    return replace(padded(found), others=tuple(map(padded, found.others)))


def _overlap(one: Bool[np.ndarray, "height width"], other: Bool[np.ndarray, "height width"]) -> float:
    """Intersection over union."""
    return float((one & other).sum() / max(1, (one | other).sum()))


def _on_white(
    pixels: Float[np.ndarray, "height width 3"],
    found: Candidate,
    threshold: float = _THRESHOLD,
    confidence: float = 1.0,
) -> CutOut:
    """Raises ``ValueError`` where it is too small, :class:`NoBackgroundError` where it is the whole image."""
    opacity, white = found.opacity, found.white
    mask = _without_specks(opacity > threshold, far=found.certain)
    if mask.sum() < _MIN_OBJECT_PIXELS:
        hint = "a larger image, or a box closer around the object, may help"
        raise ValueError(f"no object found: fewer than {_MIN_OBJECT_PIXELS} px differ from the background; {hint}")
    if mask.mean() > 0.97:
        raise NoBackgroundError
    # On white, half-covered pixels around the object are right as they are; on a colour they are left out.
    near = binary_dilation(mask, iterations=2)
    on_white = np.where((near if white else _eroded(mask))[..., None], pixels, np.float32(1))
    opacity = np.where(near, opacity, 0).astype(np.float32)
    undecided = float(((opacity > _FAINT) & (opacity < 1 - _FAINT)).sum() / mask.sum())
    return CutOut(on_white, mask, white, opacity, found.edge_error, undecided, found.found_by, confidence)


# By what a person points at


def _segment_with_hints(image: Image.Image, colours: Float[np.ndarray, "height width 3"], hints: Hints) -> CutOut:
    """GrabCut from the box, what is at the points, or what is found without either; then where strokes correct it."""
    window = (0, 0, *image.size)
    if hints.box is not None:
        left, top, right, bottom = box = _in_pixels(hints.box, *image.size)
        window = widened(box, max(4, round(_MARGIN * max(right - left, bottom - top))), colours.shape)
        mask = grabcut(colours, _in_box(box, colours.shape[:2]), window)
        found = _on_white(colours, Candidate("box", mask.astype(np.float32), certain=True))
    elif hints.points:
        found = _best(colours, _at_points(image, colours, hints.points), hints)
    else:
        found = cut_out(image, replace(hints, strokes=()))
    if not hints.strokes:
        return found
    mask = grabcut(colours, _corrected(found.mask, hints.strokes), window)
    mask = _apply_strokes(mask, hints.strokes, True, False).astype(bool)
    return _on_white(colours, Candidate("strokes", mask.astype(np.float32), certain=True))


def _at_points(
    image: Image.Image, colours: Float[np.ndarray, "height width 3"], points: tuple[tuple[float, float], ...]
) -> list[tuple[Candidate, float]]:
    """The object at a point; of several, their union."""
    first, *more = (rank_candidates(Seen(image, colours, point)) for point in points)
    added = [ranked[0] for ranked in more if ranked]

    def joined(candidate: Candidate, confidence: float) -> tuple[Candidate, float]:
        opacity = np.max([candidate.opacity, *(other.opacity for other, _ in added)], axis=0)
        return replace(candidate, opacity=opacity), min(confidence, *(sure for _, sure in added), 1.0)

    return [joined(*one) for one in first]


def _in_box(box: tuple[int, int, int, int], size: tuple[int, int]) -> UInt8[np.ndarray, "height width"]:
    """Labels of GrabCut: the object is somewhere in the box (px)."""
    import cv2

    labels = np.full(size, cv2.GC_BGD, np.uint8)
    left, top, right, bottom = box
    labels[top:bottom, left:right] = cv2.GC_PR_FGD
    return labels


def _corrected(
    mask: Bool[np.ndarray, "height width"], strokes: tuple[Stroke, ...]
) -> UInt8[np.ndarray, "height width"]:
    """Labels of GrabCut: what is under strokes is sure, what is near them in doubt, the rest stays as it was."""
    import cv2

    wide = tuple(stroke._replace(radius=_REACH * stroke.radius, adds=True) for stroke in strokes)
    doubtful = _apply_strokes(np.zeros_like(mask), wide, True, False).astype(bool)
    sure = np.where(mask, cv2.GC_FGD, cv2.GC_BGD)
    labels = np.where(doubtful, np.where(mask, cv2.GC_PR_FGD, cv2.GC_PR_BGD), sure).astype(np.uint8)
    return _apply_strokes(labels, strokes, cv2.GC_FGD, cv2.GC_BGD)


def _apply_strokes(
    values: np.ndarray, strokes: tuple[Stroke, ...], adding: int, removing: int
) -> UInt8[np.ndarray, "height width"]:
    """With the strokes drawn over it, the later over the earlier."""
    import cv2

    canvas = values.astype(np.uint8)
    height, width = canvas.shape
    for stroke in strokes:
        points = (np.array(stroke.points) * (width, height)).round().astype(np.int32)
        thickness = max(1, round(2 * stroke.radius * max(width, height)))
        value = adding if stroke.adds else removing
        cv2.polylines(canvas, [points[:, None]], False, int(value), thickness)
        for x, y in points[[0, -1]].tolist():
            cv2.circle(canvas, (x, y), thickness // 2, int(value), -1)
    return canvas


def _in_pixels(box: tuple[float, float, float, float], width: int, height: int) -> tuple[int, int, int, int]:
    left, top, right, bottom = box
    across, down = round(left * width), round(top * height)
    return across, down, max(across + 1, round(right * width)), max(down + 1, round(bottom * height))


# Masks


def _without_specks(mask: Bool[np.ndarray, "height width"], far: bool) -> Bool[np.ndarray, "height width"]:
    """The largest piece, those of at least a fifth of it, and those of a hundredth near it, or ``far`` too."""
    pieces, count = label(mask, np.ones((3, 3)))
    areas = np.bincount(pieces.ravel(), minlength=count + 1)
    areas[0] = 0
    kept = areas >= max(2, (_SPECK if far else _PIECE) * areas.max(initial=0))
    smaller = (areas >= max(2, _SPECK * areas.max(initial=0))) & ~kept
    if smaller.any():
        largest = pieces == areas.argmax()
        left, top, right, bottom = bounding_box(largest)
        distance = distance_transform_edt(~largest)
        near = minimum(distance, pieces, np.arange(count + 1)) < _NEAR * max(right - left, bottom - top)
        kept |= smaller & near
    return kept[pieces]


def _eroded(mask: Bool[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    """Less the pixels that the object shares with the background, where there are enough of its own."""
    return binary_erosion(mask, iterations=1, border_value=1) if min(mask.shape) >= 200 else mask
