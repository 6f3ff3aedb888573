"""Images as arrays: conversion to bytes, lightness of colours, and the bounding box of a mask."""

import numpy as np
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

_LIGHTNESS = 0.299, 0.587, 0.114


def to_bytes(image: Float[Tensor | np.ndarray, "*shape"]) -> UInt8[np.ndarray, "*shape"]:
    """Convert numbers in 0..1 to bytes in 0..255, rounded and clipped.

    Example:
        >>> to_bytes(np.array([-1.0, 0.5, 1.0]))
        array([  0, 128, 255], dtype=uint8)
    """
    values = image.detach().cpu().numpy() if isinstance(image, Tensor) else image
    return (np.clip(values, 0, 1) * 255 + 0.5).astype(np.uint8)


def lightness(colours: Float[Tensor, "3 *places"]) -> Float[Tensor, "*places"]:
    """Return the luma (Rec. 601) of sRGB colours."""
    red, green, blue = colours
    return _LIGHTNESS[0] * red + _LIGHTNESS[1] * green + _LIGHTNESS[2] * blue


def bounding_box(mask: Bool[Tensor | np.ndarray, "height width"]) -> tuple[int, int, int, int]:
    """Return left, top, right, bottom (exclusive) in px of a mask, which must not be empty.

    Example:
        >>> bounding_box(np.array([[False, True, True], [False, False, False]]))
        (1, 0, 3, 1)
    """
    values = mask.cpu().numpy() if isinstance(mask, Tensor) else mask
    rows = np.flatnonzero(values.any(1))
    columns = np.flatnonzero(values.any(0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
