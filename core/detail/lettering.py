"""Lettering in a photo, which is unreadable on the mirrored side, and lamps, which take no paint.

Lettering has thin strokes in more than one direction, unlike door gaps and trim, several of them in a row, unlike
handles, and paint of one colour between them, unlike lamps.
"""

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from core.detail.filters import blurred, continued, enlarged, resized
from core.detail.lookup import smooth_step
from core.geometry.pixels import lightness

_SIDE = 512  # px, longer side of the photo that is searched; lengths in px refer to it
_FLANK = 0.6, 0.8  # cosine of the normal with the car's sideways axis: lettering ahead and behind has no mirror image
_WHEEL = (5.0, 0.15, 0.05)
_PANE = (2.0, 0.6, 0.9)
"""Distance from wheels and panes at which lettering begins: px of a blur, blurred share for none and for all."""
_END = 0.4, 0.6  # cosine of the normal with the car's long axis: lamps, grille and plate are ahead and behind
_ROUGH = 0.03, 0.05  # contrast of plain paint, and of lamps, in the calmest of the windows around a pixel
_ROUGH_WINDOW = 1.0, 5  # px, standard deviation and reach of these windows
_STROKE = 7  # px, width of the widest thin stroke
_WINDOW = 7.0  # px, standard deviation of the window in which strokes count together
_THIN = 0.055, 0.042  # contrast per px across strokes in two directions, amid lettering and at its ends
_CALM = 0.12, 0.06  # contrast of thin strokes: none of a pixel's colour is paint from the first, all up to the second
_OTHER_PAINT = 0.25, 0.15  # difference from the main paint of the colour between strokes
_CONTRAST = 0.25  # difference from the colour between strokes, of a stroke that counts
_IN_A_ROW = 4  # strokes that most rows of pixels cross: "TAXI" has six
_ROWS = 0.7  # quantile over the rows of pixels
_EVEN, _SOFT = 5.0, 1.0  # px of the map, standard deviations: of the paint in place of lettering, and of its edge


def flanks(
    parts: dict[str, Float[Tensor, "h w"]], normals: Float[Tensor, "h w 3"], weight: Float[Tensor, "h w"]
) -> Float[Tensor, "h w"]:
    """Return the places that can have lettering, 0..1: paint of a car's sides, away from wheels and panes.

    Other objects have none: a chair's slats look like letters.
    """
    if not {"wheels", "glass"} <= set(parts):
        return torch.zeros_like(weight)
    wheels = parts["wheels"]
    glass = parts["glass"]
    body = 1 - wheels - glass
    wheel_blur, *wheel_ends = _WHEEL
    pane_blur, *pane_ends = _PANE
    beside_wheels = smooth_step(blurred(wheels[None], wheel_blur)[0], *wheel_ends)
    beside_panes = smooth_step(blurred(body[None], pane_blur)[0], *pane_ends)
    return (weight > 0) * body * (beside_wheels * beside_panes) * smooth_step(normals[..., 0].abs(), *_FLANK)


def with_lamps(
    parts: dict[str, Float[Tensor, "h w"]], photo: Float[Tensor, "3 h w"], normals: Float[Tensor, "h w 3"]
) -> dict[str, Float[Tensor, "h w"]]:
    """Return the probabilities of parts with those of a car's lamps, grille and plate: rough places at its ends."""
    if "glass" not in parts:
        return parts
    light = lightness(photo)[None]
    deviation, reach = _ROUGH_WINDOW
    variance = blurred(light**2, deviation) - blurred(light, deviation) ** 2
    calmest = -functional.max_pool2d(-variance.clamp_min(0).sqrt(), reach, 1, reach // 2)[0]
    lamps = smooth_step(calmest, *_ROUGH) * smooth_step(normals[..., 1].abs(), *_END) * (1 - parts["glass"])
    return {name: part * (1 - lamps) for name, part in parts.items()} | {"lamps": lamps}


def lettering(
    photo: Float[Tensor, "3 height width"], paint: Float[Tensor, "3 h w"], flank: Float[Tensor, "h w"]
) -> Float[Tensor, "h w"]:
    """Return the places of a photo with lettering, 0..1.

    Args:
        paint: the main paint near each place.
        flank: 0..1, places that can have lettering.
    """
    size = [max(_STROKE, round(_SIDE * side / max(photo.shape[1:]))) for side in photo.shape[1:]]
    image = functional.interpolate(photo[None], size, mode="bilinear", antialias=True)[0]
    allowed = enlarged(flank[None], image)
    paint = enlarged(blurred(paint, _PANE[0]), image)
    closing = -_largest(-_largest(image))
    opening = _largest(-_largest(-image))
    calm = allowed * smooth_step((closing - opening).amax(0), *_CALM)
    between = blurred(image * calm, _WINDOW) / blurred(calm, _WINDOW).clamp_min(1e-3)
    thin = _thinness(closing + opening - 2 * image, allowed)
    painted = smooth_step((between - paint).abs().amax(0), *_OTHER_PAINT)
    strokes = (image - between).abs().amax(0) > _CONTRAST
    letters = _written(thin * painted > _THIN[0], thin > _THIN[1], strokes)
    return functional.max_pool2d(resized(letters[None].float(), flank), 3, 1, 1)[0].ceil()


def without_lettering(
    image: Float[Tensor, "3 h w"], letters: Float[Tensor, "h w"], paint: Bool[Tensor, "h w"]
) -> tuple[Float[Tensor, "3 h w"], Float[Tensor, "h w"]]:
    """Return the nearest paint to each place, and the share (0..1) of an image's colours that it replaces.

    Args:
        paint: places with the main paint.
    """
    clean = continued(image, paint & (letters == 0))
    return blurred(clean, _EVEN), blurred(functional.max_pool2d(letters[None], 3, 1, 1), _SOFT)[0]


def _thinness(thin: Float[Tensor, "3 h w"], allowed: Float[Tensor, "1 h w"]) -> Float[Tensor, "h w"]:
    """Return the contrast per px of thin strokes across the direction in which it is least, in windows.

    Args:
        thin: thin dark strokes, minus thin light ones.
    """
    y, x = torch.gradient(thin, dim=(1, 2))
    products = torch.stack((x * x, x * y, y * y)).mean(1)
    xx, xy, yy = blurred(allowed * products, _WINDOW) / blurred(allowed, _WINDOW).clamp_min(0.05)
    smaller = (xx + yy) / 2 - (((xx - yy) / 2).square() + xy.square()).sqrt()
    return allowed[0] * smaller.clamp_min(0).sqrt()


def _written(certain: Bool[Tensor, "h w"], possible: Bool[Tensor, "h w"], strokes: Bool[Tensor, "h w"]) -> Tensor:
    """Return the possible regions that hold a certain place and several strokes in a row."""
    from scipy.ndimage import label

    labels, _ = label(possible.numpy())
    written = torch.zeros_like(possible)
    for number in np.unique(labels[certain.numpy() & (labels > 0)]):
        region = labels == number
        inside = strokes.numpy() & region
        begins = (inside[:, 1:] & ~inside[:, :-1]).sum(1)[region.any(1)]
        if np.quantile(begins, _ROWS) >= _IN_A_ROW:
            written |= torch.from_numpy(region)
    return written


def _largest(image: Float[Tensor, "3 h w"]) -> Float[Tensor, "3 h w"]:
    return functional.max_pool2d(image, _STROKE, 1, _STROKE // 2)
