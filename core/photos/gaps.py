"""Gaps in a mask through which the ground is seen: between slats, under arms, through a net of wire."""

import numpy as np
from jaxtyping import Bool, Float, Int
from PIL import Image
from scipy.ndimage import binary_dilation, binary_opening, gaussian_filter, label
from skimage.color import rgb2lab

from core.photos.candidates import in_pixels, scaled
from core.photos.detector import mask_box

_SIDE = 320  # px: longer side of the compared window, that of the saliency network
_SURROUNDINGS = 1.4  # scale of the mask's box to the window whose colours are the ground's
_BIN = 5.0  # CIE76 per bin of a colour histogram, two noticeable differences
_BINS = 22, 52, 52  # of lightness 0..100, and of both chromas from -130 to 130
_LEAST_DENSITY = 1e-5  # of a colour that a histogram does not hold
_BAND = 3  # px around the mask that may belong to either side
_ROUNDS = 4  # the object's colours without the gaps found so far
_NEAR = 0.08  # margin of the rows around a gap whose ground is compared, relative to the window
_SMALLEST = 0.003  # area of a gap relative to the mask's
_LARGEST = 0.25  # likewise; larger ones are rather an object of the ground's colours
_OPEN = 0.35  # fraction of a gap's surroundings outside the mask, at most: others are errors of its border
_LIKE_GROUND = 0.45  # histogram intersection of a gap and the ground beside it, at least
_LIKE_OBJECT = 0.3  # likewise of a gap and the object, at most, relative to the ground's

_Colours = Int[np.ndarray, "pixels 3"]


def find_gaps(
    image: Image.Image, mask: Bool[np.ndarray, "height width"]
) -> tuple[Float[np.ndarray, "height width"], bool]:
    """Return the opacity of gaps in a mask, 0..1, and True if a large one is doubtful.

    A gap of an RGB image is an enclosed part with the colours of the ground beside the mask, not of the object. A part
    that is too large for a gap may be the object's and stays.
    """
    import cv2  # imports in 0.2 s, and many images do not need it

    left, top, right, bottom = in_pixels(scaled(mask_box(mask), _SURROUNDINGS), image)
    crop = np.ascontiguousarray(np.asarray(image)[top:bottom, left:right])
    scale = min(1.0, _SIDE / max(crop.shape[:2]))
    size = max(1, round(crop.shape[1] * scale)), max(1, round(crop.shape[0] * scale))
    small = cv2.resize(crop, size, interpolation=cv2.INTER_AREA)
    masked = cv2.resize(mask[top:bottom, left:right].astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.5
    gaps, doubtful = _small_gaps(_bins(small), masked)
    opacity = np.zeros(mask.shape, np.float32)
    opacity[top:bottom, left:right] = cv2.resize(gaps.astype(np.float32), crop.shape[1::-1])
    return opacity, doubtful


def _small_gaps(
    colours: Int[np.ndarray, "height width 3"], mask: Bool[np.ndarray, "height width"]
) -> tuple[Bool[np.ndarray, "height width"], bool]:
    ground = ~binary_dilation(mask, iterations=_BAND)
    likely, thin = _likely_ground(colours, mask, ground)
    object_colours = _histogram(colours[mask & ~binary_dilation(thin)])
    parts, count = label(thin)
    gaps = np.zeros_like(mask)
    doubtful = False
    for number in range(1, count + 1):
        part = parts == number
        area = part.sum() / mask.sum()
        if area > _SMALLEST and _is_gap(colours, part, mask, ground, object_colours):
            doubtful |= bool(area > _LARGEST)
            gaps |= part if area <= _LARGEST else False
    return binary_dilation(gaps) & likely, doubtful


def _likely_ground(
    colours: Int[np.ndarray, "height width 3"],
    mask: Bool[np.ndarray, "height width"],
    ground: Bool[np.ndarray, "height width"],
) -> tuple[Bool[np.ndarray, "height width"], Bool[np.ndarray, "height width"]]:
    """Return pixels of the mask whose colours are likelier the ground's, and these without specks."""
    of_ground = np.log(_histogram(colours[ground]) + _LEAST_DENSITY)
    likely = np.zeros_like(mask)
    opened = likely
    for _ in range(_ROUNDS):
        of_object = np.log(_histogram(colours[mask & ~binary_dilation(opened)]) + _LEAST_DENSITY)
        odds = (of_ground - of_object)[tuple(np.moveaxis(colours, -1, 0))]
        likely = mask & (gaussian_filter(odds, 1.0) > 0)
        opened = binary_opening(likely & (odds > -1))
    return likely, opened


def _is_gap(
    colours: Int[np.ndarray, "height width 3"],
    part: Bool[np.ndarray, "height width"],
    mask: Bool[np.ndarray, "height width"],
    ground: Bool[np.ndarray, "height width"],
    object_colours: Float[np.ndarray, "lightness red_green yellow_blue"],
) -> bool:
    """True if an enclosed part of the mask looks like the ground at its height, and unlike the object."""
    around = binary_dilation(part) & ~part
    rows = np.flatnonzero(part.any(1))
    margin = round(_NEAR * len(mask))
    outside = np.zeros_like(mask)
    outside[max(0, rows[0] - margin) : rows[-1] + margin + 1] = True
    outside &= ground
    if not outside.any() or (around & ~mask).sum() > _OPEN * around.sum():
        return False
    histogram = _histogram(colours[part])
    like_ground = np.minimum(histogram, _histogram(colours[outside])).sum()
    like_object = np.minimum(histogram, object_colours).sum()
    return bool(like_ground > _LIKE_GROUND and like_object < _LIKE_OBJECT * like_ground)


def _bins(image: np.ndarray) -> Int[np.ndarray, "height width 3"]:
    """Return the histogram bins of an image's colours."""
    lab = rgb2lab(image)
    lab[..., 1:] += 130
    return np.clip(lab // _BIN, 0, np.array(_BINS) - 1).astype(int)


def _histogram(colours: _Colours) -> Float[np.ndarray, "lightness red_green yellow_blue"]:
    """Return a smooth histogram of sum 1; zero of no colours."""
    counts = np.zeros(_BINS, np.float32)
    np.add.at(counts, tuple(colours.T), 1)
    smooth = gaussian_filter(counts, 0.8, mode="constant")
    return smooth / max(float(smooth.sum()), 1e-9)
