"""Segmentation: the object by the alpha channel, a plain background, a saliency network, or what a person points at."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image
from scipy.ndimage import binary_dilation, binary_erosion, label

from core.photos.decode import lens_focal
from core.photos.frames import Box, fill, find_frame, is_sliver
from core.photos.plain_background import NoBackgroundError, PlainBackground, find_background
from core.photos.saliency import predict_saliency

MIN_SIDE = 8
"""px: an image with a shorter side than this shows nothing to fit."""
_MIN_OBJECT_PIXELS = 12
"""px of an object: with fewer it shows nothing to fit."""
_MARGIN = 0.25
"""of a box: so much around it is used to learn the background's colours"""
_GRAB_SIDE = 320
"""px: the longer side at which GrabCut works, twice what a model sees"""
_GRABCUT_ROUNDS = 4
"""of GrabCut"""
_AGREEMENT = 0.75
"""intersection over union from which a plain background and the salient object are of one opinion"""
_FAINT = 0.1
"""opacity below which the saliency network sees background"""
_UNDECIDED = 0.5
"""of an object's area: photographs of objects leave 0.04 to 0.22 of it undecided, noise and bare landscapes over 7"""
_NETWORK_ERROR = 0.006
"""of the image's longer side: two pixels of the network's own image, by which its edges may be off"""
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
    """the share of the object's area where the saliency network saw neither object nor background"""
    focal: float | None = None
    """px, where the image tells"""


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

    def __post_init__(self) -> None:
        if not 0 < self.threshold < 1:
            raise ValueError("the threshold of a cut-out is between 0 and 1")
        if self.box is not None:
            left, top, right, bottom = self.box
            if not (0 <= left < right <= 1 and 0 <= top < bottom <= 1):
                raise ValueError("the box around the object has no inside within the image")

    @property
    def pointed(self) -> bool:
        """Whether there is a box or a stroke."""
        return self.box is not None or bool(self.strokes)

    def __bool__(self) -> bool:
        return self.pointed or self.threshold != _THRESHOLD


def cut_out(image: Image.Image, hints: Hints | None = None) -> CutOut:
    """The object of an RGBA image.

    With hints by GrabCut (Rother et al. 2004, of OpenCV) from the box or, where there is none, from what would be
    found without hints; strokes hold in any case. Without: by the alpha channel, else by a background that is plain
    beyond doubt, else by a saliency network (:mod:`core.photos.saliency`), which must agree with a background that is
    in doubt.

    Raises ``ValueError`` where no object is found, :class:`NoBackgroundError` where hints could help.
    """
    if min(image.size) < MIN_SIDE:
        raise ValueError(f"an image of {image.width}x{image.height} px is too small; {MIN_SIDE} px are the least")
    return replace(_cut_out(image, hints), focal=lens_focal(image))


def _cut_out(image: Image.Image, hints: Hints | None) -> CutOut:
    values = np.asarray(image, dtype=np.float32) / 255
    colours, alpha = values[..., :3], values[..., 3:]
    if hints and hints.pointed:
        colours = colours * alpha + 1 - alpha
        return _on_white(colours, _segment_with_hints(image, colours, hints), white=False)
    return _segment_without_hints(image, colours, alpha, hints.threshold if hints else _THRESHOLD)


def _segment_without_hints(
    image: Image.Image,
    colours: Float[np.ndarray, "height width 3"],
    alpha: Float[np.ndarray, "height width 1"],
    threshold: float,
) -> CutOut:
    clear = alpha[..., 0] < 0.5
    if clear.any() and is_sliver(clear):
        colours = fill(colours, clear)
    elif clear.mean() > 0.001:
        return _on_white(colours * alpha + 1 - alpha, alpha[..., 0], white=True, threshold=threshold)
    if box := find_frame(colours):
        return _within(box, image, colours, threshold)
    plain = _plain_background(colours)
    if plain and plain.certain:
        return _on_white(colours, ~plain.mask, plain.white)
    salient = predict_saliency(image)
    if salient is None or not _is_sure(salient):
        if plain is None:
            raise NoBackgroundError
        return _on_white(colours, ~plain.mask, plain.white)
    if plain and _overlap(~plain.mask, salient > 0.5) > _AGREEMENT:
        # Colours follow edges more closely than a network of 320 px does, but take shadows for the object.
        near = binary_dilation(salient > _FAINT, iterations=max(1, round(_NETWORK_ERROR * max(image.size))))
        return _on_white(colours, ~plain.mask & near, plain.white)
    # Inside an object the network may be unsure what it sees, but not that there is something.
    edge = _NETWORK_ERROR * max(image.size)
    inside = binary_erosion(salient > 0.5, iterations=max(1, round(edge)))
    opacity = np.where(inside, np.float32(1), salient)
    cut = _on_white(colours, opacity, white=False, edge_error=edge, threshold=threshold)
    return replace(cut, undecided=float(_undecided(salient).sum() / cut.mask.sum()))


def _within(box: Box, image: Image.Image, colours: Float[np.ndarray, "height width 3"], threshold: float) -> CutOut:
    """The opacity of the object found in a part of the image; beyond is background."""
    part = colours[box.top : box.bottom, box.left : box.right]
    found = _segment_without_hints(image.crop(box), part, np.ones((*part.shape[:2], 1), np.float32), threshold)
    height, width = colours.shape[:2]
    around = (box.top, height - box.bottom), (box.left, width - box.right)
    pixels = np.pad(found.pixels, (*around, (0, 0)), constant_values=1)
    mask, opacity = np.pad(found.mask, around), np.pad(found.opacity, around)
    return replace(found, pixels=pixels, mask=mask, opacity=opacity, white=False)


def _plain_background(colours: Float[np.ndarray, "height width 3"]) -> PlainBackground | None:
    try:
        return find_background(colours)
    except NoBackgroundError:
        return None


def _is_sure(salient: Float[np.ndarray, "height width"]) -> bool:
    """Whether a saliency network sees an object: where there is none, most of what it gives is neither 0 nor 1."""
    return bool(_undecided(salient).sum() < _UNDECIDED * (salient > 0.5).sum())


def _undecided(salient: Float[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    return (salient > _FAINT) & (salient < 1 - _FAINT)


def _overlap(one: Bool[np.ndarray, "height width"], other: Bool[np.ndarray, "height width"]) -> float:
    """Intersection over union."""
    return float((one & other).sum() / max(1, (one | other).sum()))


def _on_white(
    pixels: Float[np.ndarray, "height width 3"],
    opacity: Bool[np.ndarray, "height width"] | Float[np.ndarray, "height width"],
    white: bool,
    edge_error: float = 0.0,
    threshold: float = _THRESHOLD,
) -> CutOut:
    mask = _without_specks(opacity > threshold)
    if mask.sum() < _MIN_OBJECT_PIXELS:
        hint = "a larger image, or a box closer around the object, may help"
        raise ValueError(f"no object found: fewer than {_MIN_OBJECT_PIXELS} px differ from the background; {hint}")
    if mask.mean() > 0.97:
        raise NoBackgroundError
    # On white, half-covered pixels around the object are right as they are; on a colour they are left out.
    near = binary_dilation(mask, iterations=2)
    on_white = np.where((near if white else _eroded(mask))[..., None], pixels, np.float32(1))
    return CutOut(on_white, mask, white, np.where(near, opacity, 0).astype(np.float32), edge_error)


# By what a person points at


def _segment_with_hints(
    image: Image.Image, colours: Float[np.ndarray, "height width 3"], hints: Hints
) -> Bool[np.ndarray, "height width"]:
    """GrabCut from the box, or what is found without one; then once more where strokes correct it."""
    height, width = colours.shape[:2]
    window = _around(hints.box, width, height)
    alone = Hints(threshold=hints.threshold)
    mask = (
        cut_out(image, alone).mask
        if hints.box is None
        else _grabcut(colours, _in_box(hints.box, (height, width)), window)
    )
    if not hints.strokes:
        return mask
    mask = _grabcut(colours, _corrected(mask, hints.strokes), window)
    return _apply_strokes(mask, hints.strokes, True, False).astype(bool)


def _grabcut(
    colours: Float[np.ndarray, "height width 3"],
    labels: UInt8[np.ndarray, "height width"],
    window: tuple[int, int, int, int],
) -> Bool[np.ndarray, "height width"]:
    """GrabCut within a window, at a size at which it is quick; the rest of the image is background."""
    import cv2  # costs a fifth of a second, and few images need it

    left, top, right, bottom = window
    part = np.ascontiguousarray((colours[top:bottom, left:right] * 255 + 0.5).astype(np.uint8))
    scale = min(1.0, _GRAB_SIDE / max(part.shape[:2]))
    size = max(1, round(part.shape[1] * scale)), max(1, round(part.shape[0] * scale))
    small = cv2.resize(part, size, interpolation=cv2.INTER_AREA)
    whole = np.ascontiguousarray(labels[top:bottom, left:right])
    marks = cv2.resize(whole, size, interpolation=cv2.INTER_NEAREST)
    if not np.isin(marks, (cv2.GC_FGD, cv2.GC_PR_FGD)).any():
        raise ValueError("no object found: nothing is left of it")
    if not np.isin(marks, (cv2.GC_BGD, cv2.GC_PR_BGD)).any():
        raise NoBackgroundError("the box holds the whole image: leave some of the background outside")
    cv2.setRNGSeed(0)
    memory = np.zeros((1, 65)), np.zeros((1, 65))
    decided, *_ = cv2.grabCut(small, marks, (0, 0, 1, 1), *memory, _GRABCUT_ROUNDS, cv2.GC_INIT_WITH_MASK)
    found = np.isin(decided, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.float32)
    mask = np.zeros(colours.shape[:2], dtype=bool)
    mask[top:bottom, left:right] = cv2.resize(found, part.shape[1::-1], interpolation=cv2.INTER_LINEAR) > 0.5
    return mask


def _in_box(box: tuple[float, float, float, float], size: tuple[int, int]) -> UInt8[np.ndarray, "height width"]:
    """Labels of GrabCut: the object is somewhere in the box."""
    import cv2

    labels = np.full(size, cv2.GC_BGD, np.uint8)
    left, top, right, bottom = _in_pixels(box, size[1], size[0])
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


def _around(box: tuple[float, float, float, float] | None, width: int, height: int) -> tuple[int, int, int, int]:
    """The box with a margin of background, in px; the whole image where there is none."""
    if box is None:
        return 0, 0, width, height
    left, top, right, bottom = _in_pixels(box, width, height)
    margin = max(4, round(_MARGIN * max(right - left, bottom - top)))
    return max(0, left - margin), max(0, top - margin), min(width, right + margin), min(height, bottom + margin)


# Masks


def _without_specks(mask: Bool[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    """The largest piece and those of at least a hundredth of it."""
    pieces, count = label(mask, np.ones((3, 3)))
    areas = np.bincount(pieces.ravel(), minlength=count + 1)
    areas[0] = 0
    return (areas >= max(2, 0.01 * areas.max(initial=0)))[pieces]


def _eroded(mask: Bool[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    """Less the pixels that the object shares with the background, where there are enough of its own."""
    return binary_erosion(mask, iterations=1, border_value=1) if min(mask.shape) >= 200 else mask
