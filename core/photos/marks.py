"""Marks on a shop picture, such as badges, dimension arrows, text and watermarks, told from the object."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from PIL import Image
from scipy.ndimage import distance_transform_edt, label, mean, minimum
from skimage.color import rgb2lab

from core.geometry.pixels import bounding_box
from core.photos.candidates import filled, network_candidate, salient_box, scaled
from core.photos.detector import Detection, box_overlap, mask_box

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
    and letters that touch the object are marks if they are not salient or belong to the watermark.
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
    thin = foreground & ~_opened(foreground, max(1, round(_STROKE * max(image.size))))
    return marks[pieces.numbers] | (thin & (watermark | ~salient))


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
    seen = [box for box in boxes for detection in detections if box_overlap(box, detection.box) > _SAME]
    return bool(seen or (boxes and not detections))


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


def _opened(mask: Bool[np.ndarray, "height width"], radius: int) -> Bool[np.ndarray, "height width"]:
    """Return a mask without its parts thinner than twice a radius (px)."""
    import cv2  # imports in 0.2 s, and few images need it

    element = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, element).astype(bool)
