from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import binary_fill_holes, gaussian_filter

from core.photos.candidates import mask_overlap
from core.photos.decode import read_rgba
from core.photos.gaps import find_gaps
from core.photos.segmentation import cut_out

SIDE = 200  # px
LAWN = (70, 110, 45)
SNOW = (235, 236, 240)


def slats(width: int, step: int) -> np.ndarray:
    """Return the mask of a frame with upright slats."""
    mask = np.zeros((SIDE, SIDE), bool)
    mask[50:150, 50:150] = True
    for left in range(60, 141 - width, step):
        mask[60:140, left : left + width] = False
    return mask


def before_ground(mask: np.ndarray, paint: tuple[int, ...], ground: tuple[int, ...]) -> Image.Image:
    noise = gaussian_filter(np.random.default_rng(0).standard_normal((SIDE, SIDE, 1)), (0.8, 0.8, 0)) * 30
    picture = np.where(mask[..., None], paint, np.array(ground) + noise)
    return Image.fromarray(picture.clip(0, 255).astype(np.uint8))


@pytest.mark.parametrize("ground", [LAWN, SNOW])
def test_ground_between_slats_is_found(ground: tuple[int, int, int]):
    mask = slats(10, 20)
    filled = binary_fill_holes(mask)
    gaps, doubtful = find_gaps(before_ground(mask, (160, 60, 50), ground), filled)
    left = filled & (gaps < 0.5)
    assert mask_overlap(left, mask) > 0.95
    assert not doubtful


def test_parts_unlike_the_ground_are_no_gaps():
    """A seat of another green than the lawn stays, and so does an object of the lawn's colours."""
    frame = slats(80, 100)
    picture = np.asarray(before_ground(frame, (200, 190, 180), LAWN)).copy()
    seat = binary_fill_holes(frame) & ~frame
    picture[seat] = (40, 150, 70)
    for image in (Image.fromarray(picture), before_ground(np.zeros_like(frame), LAWN, LAWN)):
        gaps, doubtful = find_gaps(image, binary_fill_holes(frame))
        assert gaps.max() < 0.5
        assert not doubtful


def test_a_large_part_like_the_ground_is_doubted_and_stays():
    frame = slats(80, 100)
    gaps, doubtful = find_gaps(before_ground(frame, (200, 190, 180), LAWN), binary_fill_holes(frame))
    assert doubtful
    assert gaps.max() < 0.5


def test_snow_behind_a_back_of_wire_is_left_out(shared: Path):
    """The network's mask fills the back."""
    cut = cut_out(read_rgba(shared / "photos/wild/c04_wire_snow.jpg"))
    back = cut.mask[90:140, 185:230]
    assert back.mean() < 0.6
    assert cut.mask[165:178, 220:270].mean() > 0.95  # the seat
