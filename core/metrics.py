"""Image and camera errors: PSNR, SSIM, rotation and translation."""

import math

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.geometry.camera import Camera

Image = Float[Tensor, "_ _ 3"] | Float[np.ndarray, "_ _ 3"]  # height, width, rgb in 0..1

MAX_PSNR = 100.0  # dB at which two images count as the same, so that the ratio stays finite


def psnr(image: Image, truth: Image) -> float:
    """Return the peak signal-to-noise ratio in dB of an image in [0, 1], at most :data:`MAX_PSNR`."""
    first, second = _arrays(image, truth)
    return psnr_from_mse(float(np.mean((first - second) ** 2)))


def psnr_from_mse(squared_error: float) -> float:
    """Return the PSNR in dB of a mean squared error per channel, at most :data:`MAX_PSNR`.

    Example:
        >>> psnr_from_mse(0.01)
        20.0
    """
    return MAX_PSNR if squared_error <= 10 ** (-MAX_PSNR / 10) else -10 * math.log10(squared_error)


def ssim(image: Image, truth: Image) -> float:
    """Return the structural similarity of colours, -1..1 (scikit-image, 7 px window). ``ValueError`` below 7 px."""
    from skimage.metrics import structural_similarity  # imports scipy.stats, which takes as long as half of torch

    first, second = _arrays(image, truth)
    if min(first.shape[:2]) < 7:
        raise ValueError(f"SSIM needs images of at least 7x7 px, got {first.shape[1]}x{first.shape[0]}")
    return float(structural_similarity(first, second, channel_axis=-1, data_range=1.0))


def silhouette_overlap(opacity: Float[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"]) -> float:
    """Intersection over union of the pixels that are more than half opaque and a mask; 1 where both are empty."""
    solid = opacity > 0.5
    union = np.count_nonzero(solid | mask)
    return np.count_nonzero(solid & mask) / union if union else 1.0


def haze(opacity: Float[np.ndarray, "h w"]) -> float:
    """The sum of 4a(1-a) over that of a, for opacities a: 0 where all pixels are empty or opaque.

    Example:
        >>> haze(np.array([[0.0, 1.0, 0.5]]))
        0.6666666666666666
    """
    return float((4 * opacity * (1 - opacity)).sum() / max(float(opacity.sum()), 1e-6))


def rotation_error(camera: Camera, truth: Camera) -> float:
    """Return the angle of the rotation between two cameras' axes, degrees."""
    difference = camera.pose()[:3, :3] - truth.pose()[:3, :3]
    # |A - B| = 2 sqrt(2) sin(angle / 2): exact for small angles, where acos of the trace is not.
    half = float(torch.linalg.matrix_norm(difference)) / (2 * math.sqrt(2))
    return math.degrees(2 * math.asin(min(1.0, half)))


def translation_error(camera: Camera, truth: Camera) -> float:
    """Return the distance between the camera positions, as a fraction of the true distance from the origin."""
    return float((camera.pose()[:3, 3] - truth.pose()[:3, 3]).norm()) / truth.distance


def _arrays(image: Image, truth: Image) -> tuple[np.ndarray, np.ndarray]:
    first, second = (np.asarray(pixels, dtype=np.float64) for pixels in (image, truth))
    if first.shape != second.shape:
        raise ValueError(f"images of different sizes: {first.shape} and {second.shape}")
    return first, second
