import io

import numpy as np
import pytest
from PIL import Image, ImageDraw

from core.photos.borders import Box, fill, find_frame, is_sliver
from core.photos.segmentation import cut_out


def photograph(size: tuple[int, int] = (200, 160)) -> Image.Image:
    """A red box before a wall that is lit from one side."""
    width, height = size
    x = np.linspace(150, 190, width)[None, :, None] * np.ones((height, 1, 3))
    image = Image.fromarray(x.astype(np.uint8))
    ImageDraw.Draw(image).rectangle((0.3 * width, 0.3 * height, 0.65 * width, 0.8 * height), fill=(180, 20, 20))
    return image


def framed(colour: str, border: tuple[int, int, int, int], jpeg: bool = True) -> Image.Image:
    """In a frame: left, top, right, bottom px."""
    inner = photograph()
    left, top, right, bottom = border
    image = Image.new("RGB", (inner.width + left + right, inner.height + top + bottom), colour)
    image.paste(inner, (left, top))
    if jpeg:
        file = io.BytesIO()
        image.save(file, "JPEG", quality=80)
        return Image.open(file)
    return image


def as_floats(image: Image.Image) -> np.ndarray:
    return np.asarray(image.convert("RGB"), np.float32) / 255


@pytest.mark.parametrize(
    ("colour", "border"),
    [
        ("black", (20, 30, 20, 30)),
        ("black", (40, 40, 40, 5)),
        ("black", (0, 50, 0, 50)),
        ("black", (0, 0, 0, 60)),
        ("white", (0, 60, 0, 60)),
        ("white", (60, 0, 60, 0)),
    ],
)
@pytest.mark.parametrize("jpeg", [False, True])
def test_a_photo_in_a_frame_is_found_within_it(colour: str, border: tuple[int, int, int, int], jpeg: bool) -> None:
    left, top = border[:2]
    found = find_frame(as_floats(framed(colour, border, jpeg)))
    assert found is not None
    np.testing.assert_allclose(found, (left, top, left + 200, top + 160), atol=12 if jpeg else 4)
    cut = cut_out(framed(colour, border, jpeg).convert("RGBA"))
    rows, columns = np.flatnonzero(cut.mask.any(1)), np.flatnonzero(cut.mask.any(0))
    np.testing.assert_allclose(columns[[0, -1]], (left + 60, left + 130), atol=12 if jpeg else 4)
    np.testing.assert_allclose(rows[[0, -1]], (top + 48, top + 128), atol=12 if jpeg else 4)
    assert not cut.white


def test_a_photo_without_a_frame_has_none() -> None:
    assert find_frame(as_floats(photograph())) is None
    for colour in ("black", "white", "grey"):
        image = Image.new("RGB", (120, 100), colour)
        assert find_frame(as_floats(image)) is None
        ImageDraw.Draw(image).ellipse((20, 20, 90, 80), fill=(180, 20, 20))  # an object on a plain background
        assert find_frame(as_floats(image)) is None
    whole = Image.new("RGB", (120, 100), "white")
    ImageDraw.Draw(whole).rectangle((20, 20, 90, 80), fill=(180, 20, 20))
    assert find_frame(as_floats(whole)) is None


def test_rounded_corners_are_no_cut_out() -> None:
    image = photograph().convert("RGBA")
    corners = Image.new("L", image.size, 0)
    ImageDraw.Draw(corners).rounded_rectangle((0, 0, 199, 159), 16, fill=255)
    image.putalpha(corners)
    clear = np.asarray(corners) < 128
    assert clear.mean() > 0.001
    assert is_sliver(clear)
    cut = cut_out(image)
    expected = cut_out(photograph().convert("RGBA"))
    assert (cut.mask != expected.mask).mean() < 0.01


def test_a_cut_out_that_fills_its_image_is_one() -> None:
    alpha = Image.new("L", (200, 100), 0)
    ImageDraw.Draw(alpha).rounded_rectangle((1, 1, 198, 98), 4, fill=255)
    assert not is_sliver(np.asarray(alpha) < 128)  # its border is clear
    alpha = Image.new("L", (200, 100), 255)
    ImageDraw.Draw(alpha).rectangle((0, 0, 199, 30), fill=0)
    assert not is_sliver(np.asarray(alpha) < 128)


def test_clear_pixels_take_the_nearest_colour() -> None:
    colours = np.zeros((4, 6, 3), np.float32)
    colours[:, 3:] = 1
    clear = np.zeros((4, 6), bool)
    clear[0, 0] = clear[0, 5] = True
    colours[clear] = 0.5
    found = fill(colours, clear)
    assert found[0, 0].max() == 0
    assert found[0, 5].min() == 1


def test_boxes_crop_as_pillow_does() -> None:
    assert photograph().crop(Box(1, 2, 11, 22)).size == (10, 20)
