"""Segmentation of the object in an image: the likeliest of several masks, corrected by a person's hints."""

from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image
from scipy.ndimage import binary_dilation, binary_erosion, distance_transform_edt, label

from core.geometry.pixels import bounding_box, to_bytes
from core.photos.candidates import (
    Candidate,
    box_candidate,
    filled,
    mask_overlap,
    network_agreement,
    network_candidate,
    rank_candidates,
    salient_box,
    salient_box_at,
)
from core.photos.chair_box import chair_corners, chair_direction
from core.photos.decode import NOTE, lens_focal, on_white
from core.photos.detector import UNDETECTED, Box, Detection, box_overlap, detect, detection_of, mask_box
from core.photos.gaps import find_gaps
from core.photos.grabcut import grabcut
from core.photos.marks import SHOP_SIDE, find_graphics, find_marks
from core.photos.plain_background import NoBackgroundError, PlainBackground, find_background, is_compact
from core.photos.reflection import above_reflection

MIN_SIDE = 8  # px: images with a shorter side are not fitted
_MIN_OBJECT_PIXELS = 12  # px: smaller objects are not fitted
_SPECK = 0.01  # area of kept pieces, relative to the largest piece
_GROUP = 0.2  # area of kept groups of neighbouring pieces, relative to the largest group
_NEAR = 0.1  # largest gap within a group, relative to the mask's size
_SAME = 0.97  # intersection over union from which two masks count as equal
_CORNERS = 0.03  # largest fraction of an image cut off by rounded corners
_FILLED = 0.98  # an object that fills so much of its box may be a photo in a frame
_FRAMED = 0.5  # fraction of an image's width and height that a framed photo takes up; a smaller block is an object
_RINGING = 3  # px beside a frame in which JPEG mixes colours
_SAME_BOX = 0.5  # overlap with the detected box below which a frame was taken for a plain background
_THRESHOLD = 0.5  # opacity from which a pixel belongs to the object
_WHOLE_EDGE = 0.97  # fraction of an image's edge; an object that is cut off or trimmed covers less of three edges
_NEARLY_ALL = 0.9  # fraction of an image; chairs and cars fill less of their bounding box
_ODD_MASK = 0.3  # confidence of a given mask that is rather a mistake
_DOUBTED = 0.5  # confidence, at most, of a mask that other evidence contradicts
_AGREED = 0.65  # overlap with the saliency network's mask below which a mask on white is doubtful
_DETECTED = 0.72  # overlap with a detected box, likewise
_REACH = 2.0  # a stroke affects pixels within this many brush radii


@dataclass(frozen=True, eq=False, kw_only=True)
class CutOut(Candidate):
    """A candidate that was put on white, at its working size."""

    pixels: Float[np.ndarray, "height width 3"]  # 0..1, on white
    mask: Bool[np.ndarray, "height width"]  # the opacity above a half
    alternatives: tuple["CutOut", ...] = ()  # other masks, the likeliest first
    focal: float | None = None  # px, if the image tells
    note: str = ""  # how an ambiguous file was read, and why its mask is rather a mistake
    detections: tuple[Detection, ...] = ()  # chairs and cars, the most prominent first
    categories: dict[str, float] = field(default_factory=dict)  # probability of each; empty if unknown
    corners: Float[np.ndarray, "9 2"] | None = None  # of the 3D box of a chair in a photograph

    @property
    def direction(self) -> tuple[float, float] | None:
        """Azimuth and elevation (rad) from the 3D box; front and back may be confused."""
        height, width = self.mask.shape
        return None if self.corners is None else chair_direction(self.corners, width / height)


class Stroke(NamedTuple):
    """A brush stroke that adds to the object or removes from it."""

    points: tuple[tuple[float, float], ...]  # fractions of the image's width and height
    radius: float  # fraction of the longer side
    adds: bool


@dataclass(frozen=True)
class Hints:
    """Hints from a person. Raises ``ValueError`` for unusable values."""

    box: Box | None = None  # contains the object
    strokes: tuple[Stroke, ...] = ()
    points: tuple[tuple[float, float], ...] = ()  # fractions of width and height, each on the object or a part of it
    choice: int = 0  # index among the masks found, the likeliest first
    object: int = 0  # index among the detected objects, the most prominent first

    def __post_init__(self) -> None:
        inside = all(0 <= fraction <= 1 for point in self.points for fraction in point)
        if min(self.choice, self.object) < 0 or not inside:
            raise ValueError("there is no such mask or object, or a point is outside the image")
        if self.box is not None:
            left, top, right, bottom = self.box
            if not (0 <= left < right <= 1 and 0 <= top < bottom <= 1):
                raise ValueError("the box around the object is empty or outside the image")

    def __bool__(self) -> bool:
        return self != Hints()


def cut_out(image: Image.Image, hints: Hints | None = None) -> CutOut:
    """Cut out the object of an RGBA image.

    Uses its alpha channel or a plain background; else the saliency network and GrabCut in a box
    (:mod:`core.photos.candidates`). The box is a person's, or that of the most prominent chair or car
    (:mod:`core.photos.detector`), or of the salient object. Strokes correct the result.

    Raises ``ValueError`` if nothing is found: an image of one colour, or hints that leave nothing.
    """
    if min(image.size) < MIN_SIDE:
        raise ValueError(f"an image of {image.width}x{image.height} px is too small; each side needs {MIN_SIDE} px")
    hints = hints or Hints()
    rgb = on_white(image)
    detected = detect(rgb)
    detections = detected or ()
    if hints.object >= max(1, len(detections)):
        raise ValueError(f"there is no object {hints.object + 1}: only {len(detections)} chairs and cars were found")
    cut = _cut_out(rgb, np.asarray(image.getchannel("A"), np.float32) / 255, hints, detections)
    if cut.white and cut.confidence < 1:  # The detector saw the marks that were removed, too.
        detected = detect(Image.fromarray(to_bytes(cut.pixels)))
    if hints.strokes:
        cut = _stroked(cut, rgb, hints.strokes)
    note = "; ".join(filter(None, (image.info.get(NOTE), cut.note)))
    cut = replace(cut, focal=lens_focal(image), note=note, detections=detected or ())
    return _with_category(cut, rgb, detected)


def _with_category(cut: CutOut, rgb: Image.Image, detected: tuple[Detection, ...] | None) -> CutOut:
    """Add the detected category and a chair's 3D box."""
    detection = detection_of(cut.mask, detected or ())
    if detection is None:
        # The detector may not recognise the category of renders, drawings and toys on white.
        return replace(cut, categories={} if cut.white or detected is None else UNDETECTED)
    # The viewpoint classifier, trained on renders, is better for renders and cut-outs on white.
    boxed = detection.category == "chairs" and not cut.white
    corners = chair_corners(rgb, detection.box) if boxed else None
    return replace(cut, categories=detection.probabilities, corners=corners)


def _cut_out(
    rgb: Image.Image, alpha: Float[np.ndarray, "height width"], hints: Hints, detections: tuple[Detection, ...]
) -> CutOut:
    """Cut out without strokes."""
    if boxes := _hinted_boxes(rgb, hints, detections):
        return _in_boxes(rgb, boxes, hints, detections)
    if _is_cut_out(alpha < 0.5):
        doubt = _doubt_about(alpha > _THRESHOLD)
        confidence = _ODD_MASK if doubt else 1.0
        cut = _on_white(rgb, Candidate("alpha channel", alpha, white=True, certain=True, confidence=confidence))
        return replace(cut, note=doubt)
    plain, confidence = _plain_background(rgb, detections)
    if plain is None:
        return _photographed(rgb, hints, detections)
    if plain.mask.all():
        raise ValueError("no object found: nothing differs from the background")
    opacity = (~plain.mask).astype(np.float32)
    candidate = Candidate("plain background", opacity, white=plain.white, certain=True, confidence=confidence)
    return _on_white(rgb, candidate)


def _photographed(rgb: Image.Image, hints: Hints, detections: tuple[Detection, ...]) -> CutOut:
    """Cut out the most prominent object of a photograph, without its mirror image."""
    box = detections[0].box if detections else salient_box(rgb)
    above = above_reflection(rgb, box)
    if above is None:
        return _in_boxes(rgb, [box], hints, detections)
    return _in_boxes(rgb, [mask_box(above & filled(box, rgb))], hints, detections, above)


def _doubt_about(mask: Bool[np.ndarray, "height width"]) -> str:
    """Return why a given mask is rather a mistake, or ""."""
    edges = mask[0], mask[-1], mask[:, 0], mask[:, -1]
    if sum(edge.mean() > _WHOLE_EDGE for edge in edges) >= 3:
        return "the mask holds three edges of the image: it may be that of the background (invert it)"
    if mask.mean() > _NEARLY_ALL:
        return f"the mask holds {mask.mean():.0%} of the image: it may hold more than the object"
    return ""


def _is_cut_out(clear: Bool[np.ndarray, "height width"]) -> bool:
    """True if an image is transparent around an object, not only at rounded corners."""
    border = np.concatenate((clear[0], clear[-1], clear[:, 0], clear[:, -1]))
    return bool(clear.mean() > (_CORNERS if border.mean() < 0.5 else 0.001))


def _plain_background(rgb: Image.Image, detections: tuple[Detection, ...]) -> tuple[PlainBackground | None, float]:
    """Find a plain background, with the marks on it, and return its confidence.

    None unless the rest is one object that hardly touches the border, or nothing.
    """
    colours = np.asarray(rgb, np.float32) / 255
    plain = find_background(colours)
    if plain is None or plain.mask.all():
        return plain, 1.0
    confidence = 1.0
    graphics = find_graphics(rgb, ~plain.mask, detections)
    plain = plain._replace(mask=plain.mask | graphics)
    marks = find_marks(rgb, ~plain.mask, detections)
    if marks is not None:
        plain = plain._replace(mask=plain.mask | marks)
    above = above_reflection(rgb, mask_box(~plain.mask))
    if above is not None:
        plain = plain._replace(mask=plain.mask | ~above)
    if marks is not None or above is not None:
        confidence = network_agreement(rgb, ~plain.mask)
    if graphics.any() or (confidence == 1 and plain.white and _is_doubtful(rgb, ~plain.mask, detections)):
        confidence = min(confidence, _DOUBTED)
    if not is_compact(~plain.mask):
        return None, 0.0
    ambiguous = marks is not None or not plain.white
    if detections and ambiguous and box_overlap(mask_box(~plain.mask), detections[0].box) < _SAME_BOX:
        return None, 0.0
    return _within_frame(colours, plain), confidence


def _is_doubtful(rgb: Image.Image, mask: Bool[np.ndarray, "height width"], detections: tuple[Detection, ...]) -> bool:
    """True if detector or saliency network see another object than a mask on white; renders are not asked."""
    if max(rgb.size) < SHOP_SIDE:
        return False
    overlaps = [box_overlap(mask_box(mask), detection.box) for detection in detections]
    if overlaps and max(overlaps) < _DETECTED:
        return True
    salient = network_candidate(rgb, mask_box(mask)).opacity > _THRESHOLD
    return bool(salient.any()) and mask_overlap(mask, salient) < _AGREED


def _within_frame(colours: Float[np.ndarray, "height width 3"], plain: PlainBackground) -> PlainBackground | None:
    """Return the plain background within a frame, if there is one; None if it is only the frame of a photo."""
    left, top, right, bottom = bounding_box(~plain.mask)
    height, width = plain.mask.shape
    if right - left < max(4 * _RINGING, _FRAMED * width) or bottom - top < max(4 * _RINGING, _FRAMED * height):
        return plain
    rows, columns = (slice(first + _RINGING, last - _RINGING) for first, last in ((top, bottom), (left, right)))
    if (~plain.mask[rows, columns]).mean() < _FILLED:
        return plain
    inner = find_background(colours[rows, columns])
    if inner is None or inner.mask.all():
        return inner and plain  # a photo, or a block of one colour
    mask = np.ones_like(plain.mask)
    mask[rows, columns] = inner.mask
    return PlainBackground(mask, white=False)


def _in_boxes(
    rgb: Image.Image,
    boxes: list[Box],
    hints: Hints,
    detections: tuple[Detection, ...],
    within: Bool[np.ndarray, "height width"] | None = None,
) -> CutOut:
    """Return the chosen mask of the objects in boxes together, with alternatives, ``within`` a mask."""
    cuts = list[CutOut]()
    for candidates in zip(*(rank_candidates(rgb, box) for box in boxes), strict=False):
        opacity = np.max([candidate.opacity for candidate in candidates], axis=0)
        confidence = min(candidate.confidence for candidate in candidates)
        merged = replace(candidates[0], opacity=opacity, certain=hints.box is not None, confidence=confidence)
        if within is not None:
            merged = replace(merged, opacity=merged.opacity * within)
        with suppress(ValueError):  # the whole image, or almost nothing
            cut = _on_white(rgb, _without_gaps(rgb, merged, detections))
            if all(mask_overlap(cut.mask, better.mask) < _SAME for better in cuts):
                cuts.append(cut)
    if not cuts:
        cuts = [_on_white(rgb, box_candidate(rgb, boxes))]
    selected = cuts.pop(min(hints.choice, len(cuts) - 1))
    return replace(selected, alternatives=tuple(cuts))


def _without_gaps(rgb: Image.Image, candidate: Candidate, detections: tuple[Detection, ...]) -> Candidate:
    """Remove the ground from the gaps of a chair; the windows of a car belong to it."""
    mask = candidate.opacity > _THRESHOLD
    detection = detection_of(mask, detections) if mask.any() else None
    if detection is None or detection.category != "chairs":
        return candidate
    gaps, doubtful = find_gaps(rgb, mask)
    confidence = min(candidate.confidence, _DOUBTED) if doubtful else candidate.confidence
    return replace(candidate, opacity=candidate.opacity * (1 - gaps), confidence=confidence)


def _hinted_boxes(rgb: Image.Image, hints: Hints, detections: tuple[Detection, ...]) -> list[Box]:
    """Return the boxes that a person points out, by a box, by points or by an object's number."""
    if hints.box is not None:
        return [hints.box]
    if hints.points:
        return [_box_at(rgb, point, detections) for point in hints.points]
    return [detections[hints.object].box] if hints.object else []


def _box_at(rgb: Image.Image, point: tuple[float, float], detections: tuple[Detection, ...]) -> Box:
    """Return the smallest detected box at a point, else the box of the salient object there."""
    x, y = point
    boxes = (detection.box for detection in detections)
    hit = [box for box in boxes if box[0] <= x <= box[2] and box[1] <= y <= box[3]]
    smallest = min(hit, key=lambda box: (box[2] - box[0]) * (box[3] - box[1]), default=None)
    return smallest or salient_box_at(rgb, point)


def _on_white(rgb: Image.Image, candidate: Candidate) -> CutOut:
    """Put an object on white. ``ValueError`` if too small, :class:`NoBackgroundError` if it is the whole image."""
    white = candidate.white
    mask = _without_specks(candidate.opacity > _THRESHOLD, far=candidate.certain)
    if mask.sum() < _MIN_OBJECT_PIXELS:
        hint = "a larger image, or a box closer around the object, may help"
        raise ValueError(f"no object found: fewer than {_MIN_OBJECT_PIXELS} px differ from the background; {hint}")
    if mask.mean() > 0.97:
        raise NoBackgroundError("no background found: draw a box around the object, or make the background transparent")
    # On white, half-covered pixels around the object are right; on a colour they are left out.
    dilated = binary_dilation(mask, iterations=2)
    coloured = dilated if white else mask
    if not white and min(mask.shape) >= 200:
        coloured = binary_erosion(mask, iterations=1, border_value=1)
    pixels = np.where(coloured[..., None], np.asarray(rgb, np.float32) / 255, np.float32(1))
    opacity = np.where(dilated, candidate.opacity, 0).astype(np.float32)
    return CutOut(**vars(replace(candidate, opacity=opacity)), pixels=pixels, mask=mask)


# Strokes


def _stroked(cut: CutOut, rgb: Image.Image, strokes: tuple[Stroke, ...]) -> CutOut:
    """Apply strokes: pixels below are certain, GrabCut decides near them."""
    mask = grabcut(rgb, _corrected(cut.mask, strokes), (0, 0, *rgb.size))
    mask = _apply_strokes(mask, strokes, True, False).astype(bool)
    return _on_white(rgb, Candidate("strokes", mask.astype(np.float32), certain=True))


def _corrected(
    mask: Bool[np.ndarray, "height width"], strokes: tuple[Stroke, ...]
) -> UInt8[np.ndarray, "height width"]:
    """Return GrabCut's labels: certain below strokes, probable near them, unchanged elsewhere."""
    import cv2

    widened = tuple(stroke._replace(radius=_REACH * stroke.radius, adds=True) for stroke in strokes)
    doubtful = _apply_strokes(np.zeros_like(mask), widened, True, False).astype(bool)
    certain = np.where(mask, cv2.GC_FGD, cv2.GC_BGD)
    labels = np.where(doubtful, np.where(mask, cv2.GC_PR_FGD, cv2.GC_PR_BGD), certain).astype(np.uint8)
    return _apply_strokes(labels, strokes, cv2.GC_FGD, cv2.GC_BGD)


def _apply_strokes(
    values: np.ndarray, strokes: tuple[Stroke, ...], adding: int, removing: int
) -> UInt8[np.ndarray, "height width"]:
    """Draw strokes, later over earlier ones."""
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


# Masks


def _without_specks(mask: Bool[np.ndarray, "height width"], far: bool) -> Bool[np.ndarray, "height width"]:
    """Drop pieces under a hundredth of the largest and, unless ``far``, groups of pieces far from the largest group."""
    if not mask.any():
        return mask
    pieces, _ = label(mask, np.ones((3, 3)))
    areas = np.bincount(pieces[mask])
    mask = mask & (areas >= _SPECK * areas.max())[pieces]
    if far:
        return mask
    left, top, right, bottom = bounding_box(mask)
    groups, _ = label(distance_transform_edt(~mask) <= _NEAR / 2 * max(right - left, bottom - top))
    areas = np.bincount(groups[mask])
    return mask & (areas >= _GROUP * areas.max())[groups]
