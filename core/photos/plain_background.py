"""Plain backgrounds of any colour: a wall, a sheet of paper, the white of a render or a catalogue."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_fill_holes, gaussian_gradient_magnitude, label
from skimage.color import rgb2lab

_BACKGROUND_DISTANCE = 9.0  # CIE76 up to which a pixel has the background's colour: four noticeable differences
_SHADOW_LIGHTNESS = 30.0  # change of lightness by soft light or shadow, at most
_EDGE_SLOPE = 1000.0  # CIE76 per image length: a steeper gradient is an edge
_EVEN = 2.5  # CIE76: variation of a border of one colour, at most
_EVEN_BORDER = 0.97  # fraction of the border that must be background
_ONE_OBJECT = 0.8  # fraction of the foreground that must be one object
_FREE_BORDER = 0.02  # fraction of the border that an object may touch


class NoBackgroundError(ValueError):
    """The object is not clear from its background, so a person must point it out."""


class PlainBackground(NamedTuple):
    """An unambiguous plain background."""

    mask: Bool[np.ndarray, "height width"]  # True on the background
    white: bool  # as in training images


def find_background(colours: Float[np.ndarray, "height width 3"]) -> PlainBackground | None:
    """Find the plain background of an image (sRGB, 0..1).

    None unless the border has one even colour.

    The background's colour may change slowly (a wall lit from one side). The background spreads from the border over
    similar colours, soft light and shadow: similar hue without an edge. Enclosed areas belong to the object unless
    their colour is the background's (the gaps in the back of a chair).
    """
    lab = rgb2lab(colours).astype(np.float32)
    fitted = _background_colour(lab)
    if fitted is None or fitted[1] >= _EVEN or fitted[2] <= _EVEN_BORDER:
        return None
    model, noise, _ = fitted
    distance = np.linalg.norm(lab - model, axis=-1)
    similar = distance < np.clip(4 * noise + 2, 2.5, _BACKGROUND_DISTANCE)
    outside = ~binary_fill_holes(~(similar | _shaded(lab, model)))
    gaps = (distance < np.clip(2 * noise, 1.0, 3.0)) & ~outside
    pieces, count = label(gaps)
    areas = np.bincount(pieces.ravel(), minlength=count + 1)
    areas[0] = 0
    outside |= (areas > 4e-4 * outside.size)[pieces]
    return PlainBackground(outside, white=bool(model[..., 0].min() > 96 and np.abs(model[..., 1:]).max() < 3))


def is_compact(mask: Bool[np.ndarray, "height width"]) -> bool:
    """True if the foreground is mostly one object that hardly touches the border."""
    border = np.concatenate((mask[0], mask[-1], mask[:, 0], mask[:, -1]))
    pieces, _ = label(mask, np.ones((3, 3)))
    areas = np.bincount(pieces.ravel())[1:]
    return bool(len(areas) and areas.max() > _ONE_OBJECT * areas.sum() and border.mean() < _FREE_BORDER)


def _background_colour(
    lab: Float[np.ndarray, "height width 3"],
) -> tuple[Float[np.ndarray, "height width 3"], float, float] | None:
    """Fit a smooth background to the border, robust to an object that touches it.

    Returns the background, its variation (CIE76), and the explained fraction of the border; None if that is too small.
    """
    height, width = lab.shape[:2]
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j].astype(np.float32)
    terms = np.stack((np.ones_like(x), x, y, x * x, y * y, x * y), -1)
    ring = np.ones((height, width), dtype=bool)
    thick = max(1, round(0.015 * min(height, width)))
    ring[thick:-thick, thick:-thick] = False
    colours = lab[ring]
    border = terms[ring]
    inliers = np.linalg.norm(colours - np.median(colours, axis=0), axis=1) < 3 * _BACKGROUND_DISTANCE
    for count in (1, 3, 6, 6):
        if inliers.sum() < 2 * count:
            return None
        factors = np.linalg.lstsq(border[inliers, :count], colours[inliers], rcond=None)[0]
        residuals = np.linalg.norm(colours - border[:, :count] @ factors, axis=1)
        inliers = residuals < (2 if count == 1 else 1) * _BACKGROUND_DISTANCE
    if inliers.mean() < 0.6:
        return None
    return terms @ factors, float(np.quantile(residuals[inliers], 0.9)), float(inliers.mean())


def _shaded(
    lab: Float[np.ndarray, "height width 3"], model: Float[np.ndarray, "height width 3"]
) -> Bool[np.ndarray, "height width"]:
    """Mark pixels explained by soft light or shadow on the background: similar hue, no edge."""
    longer = max(lab.shape)
    if longer < 200:  # too small for soft shadows: a render
        return np.zeros(lab.shape[:2], dtype=bool)
    slope = np.linalg.norm([gaussian_gradient_magnitude(lab[..., axis], 1.0) for axis in range(3)], axis=0)
    difference = lab - model
    same_hue = np.linalg.norm(difference[..., 1:], axis=-1) < 5 + 0.5 * np.linalg.norm(model[..., 1:], axis=-1)
    return (np.abs(difference[..., 0]) < _SHADOW_LIGHTNESS) & same_hue & (slope < _EDGE_SLOPE / longer)
