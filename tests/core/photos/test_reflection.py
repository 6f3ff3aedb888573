from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

from core.models.library import sample_images
from core.photos.candidates import mask_overlap
from core.photos.decode import on_white, read_rgba
from core.photos.detector import mask_box
from core.photos.reflection import above_reflection
from core.photos.segmentation import cut_out

SIDE = 300  # px


def mirrored(category: str, opacity: float) -> tuple[Image.Image, int]:
    """Return a sample on white above its fading mirror image, and the row of the line between them."""
    sample = on_white(read_rgba(sample_images(category)[0])).resize((240, 240), Image.Resampling.BICUBIC)
    pixels = np.asarray(sample, np.float32)
    bottom = int(np.flatnonzero((pixels.min(-1) < 240).any(1))[-1]) + 1
    picture = np.full((SIDE + 100, SIDE, 3), 255, np.float32)
    picture[:bottom, 30:270] = pixels[:bottom]
    fade = opacity * np.linspace(1, 0.5, bottom)[:, None, None]
    picture[bottom : 2 * bottom, 30:270] = (255 - fade * (255 - pixels[:bottom][::-1]))[: len(picture) - bottom]
    return Image.fromarray(picture.clip(0, 255).astype(np.uint8)), bottom


@pytest.mark.parametrize("category", ["cars", "chairs"])
def test_a_mirror_image_on_white_is_left_out(category: str):
    image, bottom = mirrored(category, 0.3)
    cut = cut_out(image.convert("RGBA"))
    rows = np.flatnonzero(cut.mask.any(1))
    assert abs(int(rows[-1]) + 1 - bottom) < 0.02 * SIDE
    assert cut.confidence < 1


def test_a_car_on_a_glossy_floor_is_whole_and_without_mirror_image(shared: Path):
    cut = cut_out(read_rgba(shared / "failing/6/N29_car_mirror.png"))
    truth = np.asarray(Image.open(shared / "failing/6/N29_truth.png").convert("L")) > 127
    assert mask_overlap(cut.mask, truth) > 0.95


def test_a_symmetric_object_has_no_mirror_image():
    """Its lower half is as dark as the upper one."""
    image = Image.new("RGB", (SIDE, SIDE), "white")
    pen = ImageDraw.Draw(image)
    pen.ellipse((60, 80, 240, 220), "navy")
    pen.rectangle((100, 120, 200, 180), "orange")
    assert above_reflection(image, mask_box(np.asarray(image).min(-1) < 128)) is None
