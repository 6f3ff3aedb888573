"""The 3D box of a chair in a photograph, and its viewing direction, by Objectron (Ahmadyan et al., CVPR 2021)."""

import logging
import math

import numpy as np
from jaxtyping import Float
from PIL import Image

from core.photos.detector import Box
from core.runtime.networks import NETWORKS, run_network

_SIDE = 224  # px of the network's input
_MARGIN = 1.5  # side of the crop over the object's box; best of 1.0 to 1.6 on renders of validation objects
_FOCAL = 1.5  # image heights; the azimuth is insensitive to it from 0.8 to 2.5
_ELEVATION_BIAS = math.radians(20)  # median over 97 renders of validation and foreign chairs: 23 degrees, test 14
EDGES = tuple((1 + corner, 1 + corner + bit) for bit in (1, 2, 4) for corner in range(8) if not corner & bit)
"""Pairs of corners joined by an edge of the box."""
_SIGNS = np.array([(0, 0, 0), *((x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))])
"""Centre and corners as sums of the half edges X (right), Y (up) and Z (to the front)."""


def chair_corners(image: Image.Image, box: Box) -> Float[np.ndarray, "9 2"] | None:
    """Find the centre and the eight corners of a chair's 3D box, in fractions of the image's width and height.

    Args:
        image: RGB.
        box: around the chair in the image.

    None, with a warning, if the network's file is missing or damaged.
    """
    crop, left, top, scale = _crop(image, box)
    try:
        outputs = run_network(NETWORKS / "objectron_chair.onnx", np.asarray(crop, np.float32)[None] / 255)
    except ValueError as error:
        logging.getLogger(__name__).warning("chairs are fitted without their 3D box: %s", error)
        return None
    return ((left, top) + outputs["Identity_1"].reshape(9, 2) * scale) / image.size


def chair_direction(corners: Float[np.ndarray, "9 2"], aspect: float) -> tuple[float, float]:
    """Return the azimuth and elevation (rad) from which a 3D box is seen.

    Front and back may be confused. The elevation is corrected by the network's bias.

    Each corner C + xX + yY + zZ lies on the ray through its pixel, which gives two linear equations. The singular
    vector of the least singular value is (C, X, Y, Z) up to scale.

    Args:
        corners: from :func:`chair_corners`.
        aspect: width over height of the image.
    """
    x, y = ((corners - 0.5) * (aspect, 1) / _FOCAL).T
    signs = np.concatenate((np.ones((9, 1)), _SIGNS), 1)  # of C, X, Y and Z
    zeros = np.zeros_like(signs)
    # Camera axes: x right, y up, looking along -z, so a point appears at (x, -y) / -z.
    rows = np.concatenate(
        (np.stack((signs, zeros, x[:, None] * signs), -1), np.stack((zeros, signs, -y[:, None] * signs), -1))
    )
    solution = np.linalg.svd(rows.reshape(18, 12))[2][-1].reshape(4, 3)
    centre, *edges = solution * (-1 if solution[0, 2] > 0 else 1)  # in front of the camera
    right, up, front = (-centre @ edge / np.linalg.norm(edge) for edge in edges)
    return math.atan2(front, -right), math.atan2(up, math.hypot(front, right)) - _ELEVATION_BIAS


def _crop(image: Image.Image, box: Box) -> tuple[Image.Image, float, float, float]:
    """Return a square around a box at the network's size, its corner (px), and image px per network px.

    Border pixels are repeated beyond the image.
    """
    left, top, right, bottom = (edge * size for edge, size in zip(box, image.size * 2, strict=True))
    side = _MARGIN * max(right - left, bottom - top)
    left = (left + right - side) / 2
    top = (top + bottom - side) / 2
    pad = math.ceil(max(0, -left, -top, left + side - image.width, top + side - image.height))
    padded = Image.fromarray(np.pad(np.asarray(image.convert("RGB")), ((pad, pad), (pad, pad), (0, 0)), "edge"))
    corners = left + pad, top + pad, left + pad + side, top + pad + side
    return padded.resize((_SIDE, _SIDE), Image.Resampling.BICUBIC, box=corners), left, top, side / _SIDE
