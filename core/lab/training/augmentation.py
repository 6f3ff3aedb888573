"""Photographic augmentation: changed colours, light, blur, noise, wrong masks and occlusion.

Used to train the viewpoint classifier (:mod:`core.classifiers.viewpoint`). All images are square crops, (4, side,
side): rgb on white and the mask, 0..1.
"""

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from core.classifiers.viewpoint import CROP_MARGIN
from core.geometry.camera import FRONT_AZIMUTH

_COLOUR_STD, _BRIGHTNESS_STD = 0.35, 0.2  # of the colour mixing matrix and of the shift of channels
_INVERT_PROBABILITY = 0.15
_SCALE_STD, _ASPECT_STD, _SHIFT_STD = 0.06, 0.08, 0.04
"""of an object's size, of its proportions and, in halves of an image, of its position"""
_SHADING_STD = 0.35  # slope of the light over half an image
_MIN_SIDE = 12  # px: lowest resolution that images are reduced to
_BLUR_PROBABILITY, _NOISE_PROBABILITY, _MASK_PROBABILITY, _HIDE_PROBABILITY = 0.4, 0.3, 0.3, 0.3
_MAX_NOISE = 0.12  # standard deviation
_HIDDEN = (0.1, 0.6)  # fraction of the object's box hidden along one axis
_MIN_VISIBLE = 0.25  # fraction of an object that stays visible; below, the direction is unrecognisable

Crops = Float[Tensor, "images 4 side side"]


def augment_photo(
    images: Crops, azimuth: Float[Tensor, "images"], generator: torch.Generator
) -> tuple[Crops, Float[Tensor, "images"]]:
    """Augment images like photographs and crop them to the visible object; mirroring changes azimuths (rad)."""
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
    """Mirror half of the images: a mirrored object is seen from the other side of its front."""
    mirrored = _chosen(len(images), 0.5, generator)
    turned = torch.where(mirrored[:, None, None, None], images.flip(-1), images)
    return turned, torch.where(mirrored, 2 * FRONT_AZIMUTH - azimuth, azimuth)


def recrop(images: Crops) -> Crops:
    """Scale each object to fill its image, as :func:`core.classifiers.viewpoint.crop_to_object`, unless it is empty."""
    visible = images[:, 3] > 0.5
    side = images.shape[-1]
    x = _extent(visible.any(1), side)
    y = _extent(visible.any(2), side)
    size = torch.maximum(x[:, 1] - x[:, 0], y[:, 1] - y[:, 0]) / 2 * CROP_MARGIN
    size = torch.where(visible.any((1, 2)), size, 1.0)
    affine = torch.zeros(len(images), 2, 3)
    affine[:, 0, 0] = affine[:, 1, 1] = size
    affine[:, 0, 2] = x.mean(1)
    affine[:, 1, 2] = y.mean(1)
    return _resample(images, affine)


def _extent(occupied: Bool[Tensor, "images side"], side: int) -> Float[Tensor, "images 2"]:
    """Return the occupied range of an axis, -1 to 1; all of the axis if nothing is occupied."""
    pixels = torch.arange(side)
    first = torch.where(occupied, pixels, side).amin(1)
    last = torch.where(occupied, pixels, -1).amax(1) + 1
    ends = torch.stack((first, last), 1).float() / side * 2 - 1
    return torch.where(occupied.any(1)[:, None], ends, torch.tensor([-1.0, 1.0]))


def _chosen(count: int, probability: float, generator: torch.Generator) -> Bool[Tensor, "count"]:
    """Choose each image with this probability."""
    return torch.rand(count, generator=generator) < probability


def _change_colours(images: Crops, generator: torch.Generator) -> Crops:
    """Mix and shift channels, invert some images."""
    count = len(images)
    mixing = torch.eye(3) + _COLOUR_STD * torch.randn(count, 3, 3, generator=generator)
    shift = _BRIGHTNESS_STD * torch.randn(count, 3, 1, 1, generator=generator)
    colours = torch.einsum("nij,njhw->nihw", mixing, images[:, :3] - 0.5) + 0.5 + shift
    inverted = _chosen(count, _INVERT_PROBABILITY, generator)[:, None, None, None]
    return _on_white(torch.where(inverted, 1 - colours, colours).clamp(0, 1), images[:, 3:])


def _shade(images: Crops, generator: torch.Generator) -> Crops:
    """Let the light fall off across the object, in any direction."""
    slope = _SHADING_STD * torch.randn(len(images), 2, 1, 1, generator=generator)
    axis = torch.linspace(-1, 1, images.shape[-1])
    light = (1 + slope[:, :1] * axis + slope[:, 1:] * axis[:, None]).clamp(0.2, 2)
    return _on_white((images[:, :3] * light).clamp(0, 1), images[:, 3:])


def _hide(images: Crops, generator: torch.Generator) -> Crops:
    """Occlude some objects; the mask excludes the occluder or mistakes it for the object."""
    count = len(images)
    low, high = _HIDDEN
    axis = torch.linspace(-1, 1, images.shape[-1])
    half_size = low + (high - low) * torch.rand(count, 2, 1, generator=generator)
    centre = 2 * torch.rand(count, 2, 1, generator=generator) - 1
    spans = ((axis - centre).abs() < half_size).unbind(1)
    # A third are bands from edge to edge, like posts, branches and image borders.
    columns, rows = (span | _chosen(count, 1 / 6, generator)[:, None] for span in spans)
    covered = (columns[:, None, :] & rows[:, :, None])[:, None]
    left = (images[:, 3:] * ~covered).sum((1, 2, 3)) / images[:, 3:].sum((1, 2, 3)).clamp_min(1)
    covered = covered & (_chosen(count, _HIDE_PROBABILITY, generator) & (left > _MIN_VISIBLE))[:, None, None, None]
    mistaken = _chosen(count, 1 / 3, generator)[:, None, None, None]
    near = functional.max_pool2d(images[:, 3:], 5, 1, 2) * mistaken
    mask = torch.where(covered, near, images[:, 3:])
    occluder = images[torch.randperm(count, generator=generator), :3].mean((2, 3), keepdim=True)
    return _on_white(torch.where(covered, occluder, images[:, :3]), mask)


def _corrupt_masks(images: Crops, generator: torch.Generator) -> Crops:
    """Dilate or erode some masks by a pixel or two; wrongly included pixels get any colour."""
    count = len(images)
    mask = images[:, 3:]
    wrong = _chosen(count, _MASK_PROBABILITY, generator)[:, None, None, None]
    wide = functional.max_pool2d(mask, 3, 1, 1)
    narrow = -functional.max_pool2d(-mask, 3, 1, 1)
    narrow = torch.where(
        narrow.sum((1, 2, 3), keepdim=True) > _MIN_VISIBLE * mask.sum((1, 2, 3), keepdim=True), narrow, mask
    )
    changed = torch.where(_chosen(count, 0.5, generator)[:, None, None, None], wide, narrow)
    ground = torch.rand(count, 3, 1, 1, generator=generator)
    colours = torch.where(mask > 0.5, images[:, :3], ground)
    return torch.where(wrong, _on_white(colours, changed), images)


def _place(images: Crops, generator: torch.Generator) -> Crops:
    """Change proportions and shift the crop."""
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
    """Reduce some images to a resolution down to ``_MIN_SIDE`` px."""
    side = images.shape[-1]
    if not bool(_chosen(1, _BLUR_PROBABILITY * 2, generator)):
        return images
    low = int(torch.randint(_MIN_SIDE, side, (1,), generator=generator))
    reduced = functional.interpolate(images, low, mode="area")
    coarse = functional.interpolate(reduced, side, mode="bilinear", align_corners=False)
    return torch.where(_chosen(len(images), 0.5, generator)[:, None, None, None], coarse, images)


def _add_noise(images: Crops, generator: torch.Generator) -> Crops:
    std = _MAX_NOISE * torch.rand(len(images), 1, 1, 1, generator=generator)
    std = std * _chosen(len(images), _NOISE_PROBABILITY, generator)[:, None, None, None]
    noise = torch.randn(images[:, :3].shape, generator=generator)
    return torch.cat(((images[:, :3] + std * noise * images[:, 3:]).clamp(0, 1), images[:, 3:]), 1)


def _on_white(colours: Float[Tensor, "images 3 side side"], mask: Float[Tensor, "images 1 side side"]) -> Crops:
    """Composite colours over white by a mask."""
    return torch.cat(((colours - 1) * mask + 1, mask), 1)


def _resample(images: Crops, affine: Float[Tensor, "images 2 3"]) -> Crops:
    """Resample images; ``affine`` maps output coordinates (-1 to 1) to input coordinates."""
    grid = functional.affine_grid(affine, list(images.shape), align_corners=False)
    sampled = functional.grid_sample(torch.cat((images[:, :3] - 1, images[:, 3:]), 1), grid, align_corners=False)
    return torch.cat((sampled[:, :3] + 1, sampled[:, 3:]), 1)
