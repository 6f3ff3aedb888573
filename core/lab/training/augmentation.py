"""Photographic changes to an image of an object: other colours, light, blur, grain, wrong masks, things in front.

The viewpoint classifier (:mod:`core.classifiers.viewpoint`) is trained on images that went through this. All images are
square crops, (4, side, side): rgb on white and the mask, 0..1.
"""

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from core.classifiers.crops import CROP_MARGIN
from core.geometry.camera import FRONT_AZIMUTH

_COLOUR_STD, _BRIGHTNESS_STD = 0.35, 0.2  # by how much colours are mixed and shifted
_INVERT_PROBABILITY = 0.15
_SCALE_STD, _ASPECT_STD, _SHIFT_STD = 0.06, 0.08, 0.04
"""of an object's size, of its proportions and, in halves of an image, of its place"""
_SHADING_STD = 0.35  # slope of the light across half an image
_MIN_SIDE = 12  # px: the resolution that the coarsest images are reduced to
_BLUR_PROBABILITY, _NOISE_PROBABILITY, _MASK_PROBABILITY, _HIDE_PROBABILITY = 0.4, 0.3, 0.3, 0.3
_MAX_NOISE = 0.12  # standard deviation
_HIDDEN = (0.1, 0.6)  # share of the object's box behind what is in front of it, along one axis
_MIN_VISIBLE = 0.25  # Share of an object that stays visible: of less, nobody knows the direction.

Crops = Float[Tensor, "images 4 side side"]


def augment_photo(
    images: Crops, azimuth: Float[Tensor, "images"], generator: torch.Generator
) -> tuple[Crops, Float[Tensor, "images"]]:
    """The images as photographs might show their objects, cropped to what is left of them; and their azimuths (rad),
    which mirroring changes.
    """
    images, azimuth = mirror(images, azimuth, generator)
    images = _change_colours(images, generator)
    images = _shade(images, generator)
    images = _hide(images, generator)
    images = _corrupt_masks(images, generator)
    images = recrop(_place(images, generator))
    images = _reduce(images, generator)
    return _add_noise(images, generator), azimuth


def mirror(
    images: Crops, azimuth: Float[Tensor, "images"], generator: torch.Generator
) -> tuple[Crops, Float[Tensor, "images"]]:
    """Half of the images mirrored: a mirrored object is one seen from the other side of its front."""
    mirrored = _some(len(images), 0.5, generator)
    turned = torch.where(mirrored[:, None, None, None], images.flip(-1), images)
    return turned, torch.where(mirrored, 2 * FRONT_AZIMUTH - azimuth, azimuth)


def recrop(images: Crops) -> Crops:
    """Each object scaled to fill its image again, as :func:`core.classifiers.crops.crop_to_object` leaves it.

    An image of nothing stays as it is.
    """
    visible = images[:, 3] > 0.5
    side = images.shape[-1]
    x = _extent(visible.any(1), side)
    y = _extent(visible.any(2), side)
    size = torch.maximum(x[:, 1] - x[:, 0], y[:, 1] - y[:, 0]) / 2 * CROP_MARGIN
    size = torch.where(visible.any((1, 2)), size, 1.0)
    affine = torch.zeros(len(images), 2, 3)
    affine[:, 0, 0] = affine[:, 1, 1] = size
    affine[:, 0, 2], affine[:, 1, 2] = x.mean(1), y.mean(1)
    return _resample(images, affine)


def _extent(occupied: Bool[Tensor, "images side"], side: int) -> Float[Tensor, "images 2"]:
    """From where to where an axis is occupied, from -1 to 1; all of it where nowhere."""
    places = torch.arange(side)
    first = torch.where(occupied, places, side).amin(1)
    last = torch.where(occupied, places, -1).amax(1) + 1
    ends = torch.stack((first, last), 1).float() / side * 2 - 1
    return torch.where(occupied.any(1)[:, None], ends, torch.tensor([-1.0, 1.0]))


def _some(count: int, probability: float, generator: torch.Generator) -> Bool[Tensor, "count"]:
    """True for about so large a share."""
    return torch.rand(count, generator=generator) < probability


def _change_colours(images: Crops, generator: torch.Generator) -> Crops:
    """Channels mixed and shifted, some colours inverted."""
    count = len(images)
    mixing = torch.eye(3) + _COLOUR_STD * torch.randn(count, 3, 3, generator=generator)
    shift = _BRIGHTNESS_STD * torch.randn(count, 3, 1, 1, generator=generator)
    colours = torch.einsum("nij,njhw->nihw", mixing, images[:, :3] - 0.5) + 0.5 + shift
    inverted = _some(count, _INVERT_PROBABILITY, generator)[:, None, None, None]
    return _on_white(torch.where(inverted, 1 - colours, colours).clamp(0, 1), images[:, 3:])


def _shade(images: Crops, generator: torch.Generator) -> Crops:
    """Light that falls off across the object, in any direction."""
    slope = _SHADING_STD * torch.randn(len(images), 2, 1, 1, generator=generator)
    axis = torch.linspace(-1, 1, images.shape[-1])
    light = (1 + slope[:, :1] * axis + slope[:, 1:] * axis[:, None]).clamp(0.2, 2)
    return _on_white((images[:, :3] * light).clamp(0, 1), images[:, 3:])


def _hide(images: Crops, generator: torch.Generator) -> Crops:
    """Some objects partly behind something: it is cut away, or it is taken for a part of the object."""
    count, side = len(images), images.shape[-1]
    low, high = _HIDDEN
    axis = torch.linspace(-1, 1, side).expand(count, side)
    share = low + (high - low) * torch.rand(count, 2, generator=generator)
    centre = 2 * torch.rand(count, 2, generator=generator) - 1
    across, down = ((axis - centre[:, one : one + 1]).abs() < share[:, one : one + 1] for one in (0, 1))
    # A third of them are bands from edge to edge, as posts, branches and edges of images are.
    across, down = (part | _some(count, 1 / 6, generator)[:, None] for part in (across, down))
    covered = (across[:, None, :] & down[:, :, None])[:, None]
    left = (images[:, 3:] * ~covered).sum((1, 2, 3)) / images[:, 3:].sum((1, 2, 3)).clamp_min(1)
    covered = covered & (_some(count, _HIDE_PROBABILITY, generator) & (left > _MIN_VISIBLE))[:, None, None, None]
    mistaken = _some(count, 1 / 3, generator)[:, None, None, None]
    near = functional.max_pool2d(images[:, 3:], 5, 1, 2) * mistaken
    mask = torch.where(covered, near, images[:, 3:])
    others = images[torch.randperm(count, generator=generator), :3].mean((2, 3), keepdim=True)
    return _on_white(torch.where(covered, others, images[:, :3]), mask)


def _corrupt_masks(images: Crops, generator: torch.Generator) -> Crops:
    """Some masks are a pixel or two too wide or too narrow; what they wrongly hold is of any colour."""
    count, mask = len(images), images[:, 3:]
    wrong = _some(count, _MASK_PROBABILITY, generator)[:, None, None, None]
    wide = functional.max_pool2d(mask, 3, 1, 1)
    narrow = -functional.max_pool2d(-mask, 3, 1, 1)
    narrow = torch.where(
        narrow.sum((1, 2, 3), keepdim=True) > _MIN_VISIBLE * mask.sum((1, 2, 3), keepdim=True), narrow, mask
    )
    changed = torch.where(_some(count, 0.5, generator)[:, None, None, None], wide, narrow)
    ground = torch.rand(count, 3, 1, 1, generator=generator)
    colours = torch.where(mask > 0.5, images[:, :3], ground)
    return torch.where(wrong, _on_white(colours, changed), images)


def _place(images: Crops, generator: torch.Generator) -> Crops:
    """Other proportions, and masks that are not quite where they should be."""
    count = len(images)

    def normal(std: float, *shape: int) -> Tensor:
        return std * torch.randn(count, *shape, generator=generator)

    affine = torch.zeros(count, 2, 3)
    size = 1 + normal(_SCALE_STD)
    affine[:, 0, 0] = size * (1 + normal(_ASPECT_STD))
    affine[:, 1, 1] = size * (1 + normal(_ASPECT_STD))
    affine[:, :, 2] = normal(_SHIFT_STD, 2)
    return _resample(images, affine)


def _reduce(images: Crops, generator: torch.Generator) -> Crops:
    """Some images at a resolution down to ``_MIN_SIDE`` px."""
    count, side = len(images), images.shape[-1]
    if not bool(_some(1, _BLUR_PROBABILITY * 2, generator)):
        return images
    low = int(torch.randint(_MIN_SIDE, side, (1,), generator=generator))
    reduced = functional.interpolate(images, low, mode="area")
    coarse = functional.interpolate(reduced, side, mode="bilinear", align_corners=False)
    return torch.where(_some(count, 0.5, generator)[:, None, None, None], coarse, images)


def _add_noise(images: Crops, generator: torch.Generator) -> Crops:
    std = _MAX_NOISE * torch.rand(len(images), 1, 1, 1, generator=generator)
    std = std * _some(len(images), _NOISE_PROBABILITY, generator)[:, None, None, None]
    noise = torch.randn(images[:, :3].shape, generator=generator)
    return torch.cat(((images[:, :3] + std * noise * images[:, 3:]).clamp(0, 1), images[:, 3:]), 1)


def _on_white(colours: Float[Tensor, "images 3 side side"], mask: Float[Tensor, "images 1 side side"]) -> Crops:
    """Colours where the mask is, white elsewhere."""
    return torch.cat(((colours - 1) * mask + 1, mask), 1)


def _resample(images: Crops, affine: Float[Tensor, "images 2 3"]) -> Crops:
    """The images at other places: ``affine`` takes output coordinates (-1 to 1) to those of the input."""
    grid = functional.affine_grid(affine, list(images.shape), align_corners=False)
    found = functional.grid_sample(torch.cat((images[:, :3] - 1, images[:, 3:]), 1), grid, align_corners=False)
    return torch.cat((found[:, :3] + 1, found[:, 3:]), 1)
