"""A cut-out as a person sees it: the whole photo with the outline of the mask, and boxes of objects."""

import io
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image
from scipy.ndimage import binary_dilation, binary_erosion

from core.geometry.pixels import bounding_box
from core.photos.decode import on_white
from core.photos.detector import Box
from core.photos.photo import DOUBTFUL_MASK
from core.photos.segmentation import CutOut
from core.runtime.reading import open_image

_RIVAL, _LEAST = 0.7, 0.25  # prominence relative to the first object's: to ask which is meant, and to draw a box
_FRAMED = 0.97  # fraction of its bounding box from which a mask is rather a photo in a frame; chairs and cars fill less
_SURE = 60, 220, 130  # colour of the outline
_DOUBTFUL = 255, 170, 40  # colour of a doubtful outline
_THIN = 1 / 300  # half the width of the outline, as a fraction of the photo's longer side
_KEPT = 800  # px, longest side of a photo that is kept with a project or beside an object: 20 to 150 kB
_MAX_BYTES = 16_000_000  # of the decoded pixels of such a photo


@dataclass(frozen=True, eq=False)
class CutOutPreview:
    """A photo on white with the outline of its cut-out."""

    pixels: UInt8[np.ndarray, "height width 3"]
    boxes: tuple[Box, ...]  # boxes of chairs and cars, the most prominent first

    @classmethod
    def of(cls, image: Image.Image, cut: CutOut) -> "CutOutPreview":
        """Draw the outline of a cut-out over its RGBA image."""
        colour = _DOUBTFUL if is_doubtful(cut) else _SURE
        threshold = _LEAST * max((detection.prominence for detection in cut.detections), default=0.0)
        boxes = tuple(detection.box for detection in cut.detections if detection.prominence >= threshold)
        return cls(outlined(pixels_on_white(image), cut.mask, colour), boxes)

    @cached_property
    def compressed(self) -> bytes:
        """The pixels, made smaller, as the bytes of a WebP file."""
        image = Image.fromarray(self.pixels)
        image.thumbnail((_KEPT, _KEPT))
        file = io.BytesIO()
        image.save(file, "WEBP", quality=85)
        return file.getvalue()


def read_compressed(file: bytes) -> UInt8[np.ndarray, "height width 3"]:
    """Decode a file of :attr:`CutOutPreview.compressed`. Raises ``ValueError`` if it is none."""
    with open_image(io.BytesIO(file), limit=_MAX_BYTES) as image:
        return np.array(image.convert("RGB"))


def is_doubtful(cut: CutOut) -> bool:
    """Return whether the mask may include more or less than one whole object, or be a photo in a frame."""
    left, top, right, bottom = bounding_box(cut.mask)
    fills = cut.mask[top:bottom, left:right].mean() > _FRAMED
    framed = fills and not cut.white and cut.found_by == "plain background"
    return bool(framed or cut.confidence < DOUBTFUL_MASK)


def has_rival(cut: CutOut) -> bool:
    """Return whether a second object is nearly as prominent; always False on a white background."""
    if cut.white or len(cut.detections) < 2:
        return False
    first, second, *_ = cut.detections
    return second.prominence > _RIVAL * first.prominence


def pixels_on_white(image: Image.Image, side: int | None = None) -> UInt8[np.ndarray, "height width 3"]:
    """Return the pixels of an RGBA image on white; ``side`` limits the longer side, px."""
    small = image.copy()
    if side is not None:
        small.thumbnail((side, side))
    return np.asarray(on_white(small))


def outlined(
    pixels: UInt8[np.ndarray, "height width 3"], mask: Bool[np.ndarray, "h w"], colour: tuple[int, int, int]
) -> UInt8[np.ndarray, "height width 3"]:
    """Return the pixels with the outline of a mask, which may have another size."""
    inside = np.asarray(Image.fromarray(mask).resize(pixels.shape[1::-1]))
    thick = max(1, round(_THIN * max(inside.shape)))
    edge = binary_dilation(inside, iterations=thick) & ~binary_erosion(inside, iterations=thick)
    return np.where(edge[..., None], np.array(colour, np.uint8), pixels)
