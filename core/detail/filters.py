"""Filters of maps over an image: blur, resampling, continuation of known values, distance from a mask."""

import math

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

_LEVELS = 6


def distance(mask: Bool[Tensor, "h w"], beyond: bool = False) -> Float[Tensor, "h w"]:
    """Return the distance in px from each pixel of a mask to the nearest pixel outside.

    Args:
        beyond: True: the mask continues beyond the image.
    """
    from scipy.ndimage import distance_transform_edt

    if beyond and bool(mask.all()):
        return torch.full(mask.shape, torch.inf)
    padded = np.pad(mask.numpy(), 1, constant_values=beyond)
    return torch.from_numpy(distance_transform_edt(padded)[1:-1, 1:-1].astype(np.float32))


def continued(image: Float[Tensor, "channels h w"], valid: Bool[Tensor, "h w"]) -> Float[Tensor, "channels h w"]:
    """Fill the other pixels with the nearest valid value; without any, return the image."""
    from scipy.ndimage import distance_transform_edt

    if not bool(valid.any()):
        return image
    rows, columns = distance_transform_edt(~valid.numpy(), return_distances=False, return_indices=True)
    return image[:, torch.from_numpy(rows).long(), torch.from_numpy(columns).long()]


def resized(image: Float[Tensor, "channels height width"], like: Float[Tensor, "h w"]) -> Float[Tensor, "channels h w"]:
    """Average areas down to the size of another image."""
    rows, columns = like.shape
    return functional.adaptive_avg_pool2d(image[None], (rows, columns))[0]


def enlarged(
    image: Float[Tensor, "channels h w"], like: Float[Tensor, "3 height width"]
) -> Float[Tensor, "channels height width"]:
    """Interpolate bilinearly to the size of another image."""
    return functional.interpolate(image[None], like.shape[1:], mode="bilinear", align_corners=False)[0]


def blurred(image: Float[Tensor, "channels h w"], deviation: float) -> Float[Tensor, "channels h w"]:
    """Blur by a Gaussian (px); borders are replicated."""
    half = math.ceil(3 * deviation)
    kernel = torch.exp(-((torch.arange(-half, half + 1) / deviation) ** 2) / 2)
    kernel = kernel / kernel.sum()
    padded = functional.pad(image[:, None], (half,) * 4, mode="replicate")
    return functional.conv2d(functional.conv2d(padded, kernel[None, None, None]), kernel[None, None, :, None])[:, 0]


def levels(fine: Float[Tensor, "4 height width"], device: torch.device) -> tuple[Float[Tensor, "4 _ _"], ...]:
    """Return a map at all sizes, each half the previous one."""
    images = [fine]
    while len(images) < _LEVELS and min(images[-1].shape[1:]) > 32:
        images.append(functional.avg_pool2d(images[-1][None], 2, ceil_mode=True, count_include_pad=False)[0])
    return tuple(level.to(device).contiguous() for level in images)
