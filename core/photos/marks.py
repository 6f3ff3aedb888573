"""Marks on a shop picture, such as badges, dimension arrows, text and watermarks, told from the object."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from PIL import Image
from scipy.ndimage import binary_dilation, binary_fill_holes, distance_transform_edt, find_objects, label, mean, minimum
from skimage.color import rgb2lab

from core.geometry.pixels import bounding_box
from core.photos.candidates import filled, network_candidate, salient_box, scaled
from core.photos.detector import Box, Detection, box_overlap, mask_box

SHOP_SIDE = 200  # px: longer side from which an image may have badges; smaller ones are renders
_GAP = 0.03  # distance from the object, relative to its size, from which a piece is apart; white parts leave less
_LEAST = 6  # px: smaller pieces are specks
_SPECKS = 1e-3  # area of all pieces apart, relative to the object's, below which they are specks
_OTHER = 0.2  # area relative to the object's from which a piece may be another object
_SAME = 0.3  # overlap with a detected box from which it is another object
_MARGIN = 1.1  # scale of the object's box, outside which salient pieces are marks, too
_STROKE = 0.006  # half width of lines and letters, relative to the image's longer side
_LIGHT = 60.0  # CIE lightness of the darkest watermark
_GREY = 8.0  # chroma of the most colourful watermark
_EVEN = 4.0  # CIE76 within a watermark
_LETTERS = 2  # small pieces of one light grey that make a watermark
_GRAPHICS = 0.5  # area of badges and lines, relative to the foreground's, from which they are rather the object
_FLAT = 6  # 0..255, variation of a badge's colour
_LONG = 0.05  # length of a stroke beyond the detected box, relative to the image's longer side
_AROUND = 1.15  # size of that box relative to the detected one, which may end above thin feet
_MIXED = 25.0  # 0..255, distance of a stroke's edge from the mixtures of its colour and white
_BADGE = 0.01, 0.4  # area of a badge, relative to the foreground's
_WHOLE_SHAPE = 0.95  # overlap with a disc or an upright rectangle; the object's flat sides have other outlines
_ROUND = 0.8  # width of a disc relative to its height, or the other way around
_BESIDE_BACKGROUND = 0.25  # fraction of a badge's outline, at least; the object's sides have soft edges
_INKED = 0.5  # fraction of a badge without its letters, at least; rings have less
_RIM = 3  # px around a badge whose colours are mixed
_TYRE = 40.0  # CIE lightness of the lightest tyre: a grey disc, too
_LETTER = 1e-4  # area of a letter relative to the object's


class _Pieces(NamedTuple):
    """The connected pieces of a foreground, by number; number 0 is the background."""

    numbers: Int[np.ndarray, "height width"]
    areas: Int[np.ndarray, "pieces"]  # px
    small: Bool[np.ndarray, "pieces"]  # all but the largest piece
    apart: Bool[np.ndarray, "pieces"]  # small and far from the largest piece

    def fraction(self, mask: Bool[np.ndarray, "height width"]) -> Float[np.ndarray, "pieces"]:
        """Return the fraction of each piece within a mask."""
        return np.asarray(mean(mask, self.numbers, np.arange(len(self.areas))))


def find_marks(
    image: Image.Image, foreground: Bool[np.ndarray, "height width"], detections: tuple[Detection, ...]
) -> Bool[np.ndarray, "height width"] | None:
    """Return the marks in the foreground of an RGB image with a plain background; None without pieces apart.

    Pieces apart from the object are marks if they are outside its box, not salient, or a watermark. Beside them, lines
    and letters that touch the object are marks if they are not salient or belong to the watermark. None, too, if no
    object would be left.
    """
    pieces = _find_pieces(foreground)
    if pieces.areas[pieces.apart].sum() <= _SPECKS * pieces.areas.max():
        return None
    if _has_other_object(pieces, detections):
        return np.zeros_like(foreground)
    box = detections[0].box if detections else salient_box(image)
    salient = network_candidate(image, box).opacity > 0.5
    watermark = _watermark(image, pieces)
    inside = pieces.fraction(filled(scaled(box, _MARGIN), image)) > 0.5
    marks = pieces.apart & ~(inside & (pieces.fraction(salient) > 0.5))
    marks |= pieces.small & (pieces.fraction(watermark) > 0.5)
    mask = marks[pieces.numbers] | (_thin(foreground) & (watermark | ~salient))
    return mask if (foreground & ~mask).any() else None


def find_graphics(
    image: Image.Image, foreground: Bool[np.ndarray, "height width"], detections: tuple[Detection, ...]
) -> Bool[np.ndarray, "height width"]:
    """Return badges and lines that touch the object of an RGB image.

    Nothing in renders, or if they are most of the foreground: then they are rather the object.
    """
    nothing = np.zeros_like(foreground)
    if max(image.size) < SHOP_SIDE:
        return nothing
    box = detections[0].box if detections else None
    badges = find_badges(image, foreground, box)
    strokes = find_strokes(image, foreground, box) if box else nothing
    graphics = badges | strokes
    return graphics if (foreground & graphics).sum() < _GRAPHICS * foreground.sum() else nothing


def find_badges(
    image: Image.Image, foreground: Bool[np.ndarray, "height width"], box: Box | None
) -> Bool[np.ndarray, "height width"]:
    """Return the discs and upright rectangles of one colour that touch the object of an RGB image.

    As they are printed over the object, their outlines are whole. Flat parts of an object are upright rectangles, too,
    but within the box in which it is detected.
    """
    import cv2  # imports in 0.2 s, and many images do not need it

    colours = np.asarray(image)
    element = np.ones((3, 3), np.uint8)
    spread = (cv2.dilate(colours, element) - cv2.erode(colours, element)).max(-1)
    regions, count = label(foreground & (spread <= _FLAT))
    areas = np.bincount(regions.ravel(), minlength=count + 1) / foreground.sum()
    pieces, _ = label(foreground, np.ones((3, 3)))
    badges = np.zeros_like(foreground)
    detected = np.ones_like(foreground) if box is None else filled(box, image)
    for number, window in enumerate(find_objects(regions), 1):
        region = regions[window] == number
        beyond = bool(region.sum() > 2 * (region & detected[window]).sum())
        if _BADGE[0] < areas[number] < _BADGE[1] and _is_badge(region, colours[window], beyond):
            shape = np.zeros_like(foreground)
            shape[window] = binary_fill_holes(region)
            grown = binary_dilation(shape, iterations=_RIM)
            touches = ((pieces == pieces[shape & foreground].max()) & ~grown).any()
            if touches and (grown & ~foreground).sum() > _BESIDE_BACKGROUND * (grown & ~shape).sum():
                badges |= grown
    return badges


def find_strokes(
    image: Image.Image, foreground: Bool[np.ndarray, "height width"], box: Box
) -> Bool[np.ndarray, "height width"]:
    """Return the lines of the foreground that leave the detected object's box, such as rings and arrows."""
    thin = _thin(foreground)
    beyond, _ = label(thin & ~filled(scaled(box, _AROUND), image), np.ones((3, 3)))
    colours = np.asarray(image, np.float32)
    strokes = np.zeros_like(foreground)
    lines, _ = label(thin, np.ones((3, 3)))
    for number, (rows, columns) in enumerate(find_objects(beyond), 1):
        if max(rows.stop - rows.start, columns.stop - columns.start) > _LONG * max(image.size):
            line = beyond == number
            joined = np.isin(lines, np.unique(lines[line]))
            strokes |= joined & _is_mixture(colours, np.median(colours[line], axis=0))
    return binary_dilation(strokes)


def _is_mixture(
    colours: Float[np.ndarray, "height width 3"], ink: Float[np.ndarray, "3"]
) -> Bool[np.ndarray, "height width"]:
    """Mark the pixels whose colours (0..255) are mixtures of an ink and white."""
    from_white = ink - 255
    amount = ((colours - 255) @ from_white / max(float(from_white @ from_white), 1.0)).clip(0, 1)
    return np.linalg.norm(colours - 255 - amount[..., None] * from_white, axis=-1) < _MIXED


def _is_badge(
    region: Bool[np.ndarray, "rows columns"], colours: UInt8[np.ndarray, "rows columns 3"], beyond: bool
) -> bool:
    """True for a region that fills a disc, or its bounding box, with one colour that no tyre has.

    Args:
        beyond: most of it is outside the box in which the object is detected, as rectangles have to be.
    """
    colour = np.median(colours[region], axis=0)
    if np.quantile(np.abs(colours[region] - colour).max(-1), 0.95) > _FLAT:
        return False
    shape = binary_fill_holes(region)
    if region.sum() < _INKED * shape.sum():
        return False
    height, width = shape.shape
    if shape.mean() > _WHOLE_SHAPE:
        return beyond
    y, x = (np.mgrid[:height, :width] + 0.5) / np.array([height, width])[:, None, None] - 0.5
    disc = x * x + y * y < 0.25
    lightness, *chroma = rgb2lab(colour / 255)
    tyre = lightness < _TYRE and np.hypot(*chroma) < _GREY
    like_disc = (shape & disc).sum() / (shape | disc).sum()
    return bool(like_disc > _WHOLE_SHAPE and min(height, width) > _ROUND * max(height, width) and not tyre)


def _find_pieces(foreground: Bool[np.ndarray, "height width"]) -> _Pieces:
    numbers, count = label(foreground, np.ones((3, 3)))
    areas = np.bincount(numbers.ravel(), minlength=count + 1)
    areas[0] = 0
    largest = numbers == areas.argmax()
    left, top, right, bottom = bounding_box(largest)
    gaps = np.asarray(minimum(distance_transform_edt(~largest), numbers, np.arange(count + 1)))
    small = (areas >= _LEAST) & (gaps > 0)
    return _Pieces(numbers, areas, small, small & (gaps > _GAP * max(right - left, bottom - top)))


def _has_other_object(pieces: _Pieces, detections: tuple[Detection, ...]) -> bool:
    """True if a large piece apart may be the wanted object: the detector finds it, or nothing."""
    large = np.flatnonzero(pieces.apart & (pieces.areas > _OTHER * pieces.areas.max()))
    boxes = [mask_box(pieces.numbers == number) for number in large]
    detected = [box for box in boxes for detection in detections if box_overlap(box, detection.box) > _SAME]
    return bool(detected or (boxes and not detections))


def _watermark(image: Image.Image, pieces: _Pieces) -> Bool[np.ndarray, "height width"]:
    """Mark pixels of the colour that most small pieces share, if that is a light grey."""
    lab = rgb2lab(np.asarray(image)).astype(np.float32)
    letters = np.flatnonzero(pieces.small & (pieces.areas > _LETTER * pieces.areas.max()))
    colours = [np.median(lab[pieces.numbers == number], axis=0) for number in letters]
    grey = np.median(colours, axis=0) if colours else np.zeros(3)
    if grey[0] < _LIGHT or np.hypot(*grey[1:]) > _GREY:
        return np.zeros_like(pieces.numbers, bool)
    alike = sum(np.linalg.norm(colour - grey) < _EVEN for colour in colours)
    like = np.linalg.norm(lab - grey, axis=-1) < _EVEN
    return like if alike >= max(_LETTERS, len(colours) / 2) else np.zeros_like(like)


def _thin(mask: Bool[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    """Return the parts of a mask as thin as lines and letters."""
    import cv2  # imports in 0.2 s, and few images need it

    radius = max(1, round(_STROKE * max(mask.shape)))
    element = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return mask & ~cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, element).astype(bool)
