from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

from core.models.library import sample_images
from core.photos.candidates import mask_overlap
from core.photos.decode import on_white, read_rgba
from core.photos.detector import Detection
from core.photos.marks import find_badges, find_marks
from core.photos.segmentation import CutOut, cut_out

SIDE = 600  # px
GREY = (60, 60, 60)


@cache
def shop_picture(category: str) -> Image.Image:
    """A sample in the middle of a white picture."""
    sample = on_white(read_rgba(sample_images(category)[1])).resize((420, 420), Image.Resampling.BICUBIC)
    picture = Image.new("RGB", (SIDE, SIDE), "white")
    picture.paste(sample, (90, 90))
    return picture


@cache
def clean_cut(category: str) -> CutOut:
    return cut_out(shop_picture(category).convert("RGBA"))


def badge(pen: ImageDraw.ImageDraw) -> None:
    pen.ellipse((SIDE - 110, 10, SIDE - 10, 110), fill=(200, 30, 30))
    pen.text((SIDE - 60, 60), "NEW", fill="white", anchor="mm", font_size=24)


def arrows(pen: ImageDraw.ImageDraw) -> None:
    for start, end in (((30, 60), (30, 540)), ((60, 570), (540, 570))):
        pen.line((start, end), GREY, 3)
        for x, y in (start, end):
            pen.regular_polygon((x, y, 9), 3, fill=GREY)
    pen.text((10, 20), "92 cm", fill=GREY, font_size=24)


def caption(pen: ImageDraw.ImageDraw) -> None:
    pen.text((SIDE / 2, 565), "Shop Ltd.  EUR 59.99", fill="black", anchor="mm", font_size=32)


def swatches(pen: ImageDraw.ImageDraw) -> None:
    for x, colour in ((20, "maroon"), (80, "navy"), (140, "tan")):
        pen.ellipse((x, 540, x + 45, 585), fill=colour)


def extension_lines(pen: ImageDraw.ImageDraw) -> None:
    """Dimension lines that touch the object."""
    left, top, right, bottom = (120, 180, 480, 420)
    for y in (top, bottom):
        pen.line((25, y, 300, y), (110, 110, 110), 2)
    for x in (left, right):
        pen.line((x, 575, x, 300), (110, 110, 110), 2)
    pen.text((20, 500), "60 x 92", fill=(110, 110, 110), font_size=24)


@pytest.mark.parametrize("draw", [badge, arrows, caption, swatches])
@pytest.mark.parametrize("category", ["cars", "chairs"])
def test_marks_apart_from_the_object_are_left_out(category: str, draw: Callable[[ImageDraw.ImageDraw], None]):
    picture = shop_picture(category).copy()
    draw(ImageDraw.Draw(picture))
    cut = cut_out(picture.convert("RGBA"))
    assert mask_overlap(cut.mask, clean_cut(category).mask) > 0.98
    assert max(cut.categories, key=cut.categories.__getitem__) == category
    assert cut.confidence < 1


def round_badge(pen: ImageDraw.ImageDraw, x: int, y: int) -> None:
    pen.ellipse((x - 50, y - 50, x + 50, y + 50), fill=(210, 30, 30))
    pen.text((x, y), "-20%", fill="white", anchor="mm", font_size=30)


def plate(pen: ImageDraw.ImageDraw, x: int, y: int) -> None:
    pen.rectangle((x - 45, y - 25, x + 45, y + 25), fill=(70, 110, 60))
    pen.text((x, y), "ECO", fill="white", anchor="mm", font_size=26)


@pytest.mark.parametrize("draw", [round_badge, plate])
@pytest.mark.parametrize("category", ["cars", "chairs"])
def test_a_badge_that_touches_the_object_is_left_out_and_doubted(category: str, draw: Callable[..., None]):
    truth = clean_cut(category).mask
    picture = shop_picture(category).copy()
    rows, columns = np.nonzero(truth)
    corner = (columns - rows).argmax()
    draw(ImageDraw.Draw(picture), int(columns[corner]) + 28, int(rows[corner]) - 15)
    cut = cut_out(picture.convert("RGBA"))
    assert mask_overlap(cut.mask, truth) > 0.95
    assert max(cut.categories, key=cut.categories.__getitem__) == category
    assert cut.confidence <= 0.5


def test_a_flat_seat_is_no_badge():
    picture = Image.new("RGB", (SIDE, SIDE), "white")
    pen = ImageDraw.Draw(picture)
    pen.polygon([(220, 330), (250, 330), (230, 560), (190, 560)], fill=(90, 90, 90))
    pen.polygon([(350, 330), (380, 330), (410, 560), (370, 560)], fill=(90, 90, 90))
    pen.rectangle((200, 290, 400, 330), fill=(190, 30, 30))
    foreground = np.asarray(picture).min(-1) < 250
    box = (0.3, 0.4, 0.7, 0.95)
    assert not find_badges(picture, foreground, box).any() and not find_badges(picture, foreground, None).any()
    assert find_badges(picture, foreground, (0.3, 0.55, 0.7, 0.95))[310, 300]


@pytest.mark.parametrize("category", ["cars", "chairs"])
def test_a_ring_around_the_object_is_doubted(category: str):
    picture = shop_picture(category).copy()
    ImageDraw.Draw(picture).ellipse((105, 105, 495, 495), outline=(40, 120, 200), width=6)
    cut = cut_out(picture.convert("RGBA"))
    assert cut.confidence <= 0.5 or mask_overlap(cut.mask, clean_cut(category).mask) > 0.95


def watermarked(picture: Image.Image) -> Image.Image:
    """A picture below translucent grey letters."""
    letters = Image.new("RGBA", (SIDE, 100))
    ImageDraw.Draw(letters).text((SIDE / 2, 50), "SHOP EXAMPLE", (120, 120, 120, 115), anchor="mm", font_size=70)
    marked = picture.convert("RGBA")
    marked.alpha_composite(letters.rotate(25, expand=True).crop((0, 0, SIDE, 300)), (0, 150))
    return marked


@pytest.mark.parametrize("category", ["cars", "chairs"])
def test_a_watermark_and_lines_that_touch_the_object_are_left_out(category: str):
    truth = clean_cut(category).mask
    cut = cut_out(watermarked(shop_picture(category)))
    assert mask_overlap(cut.mask, truth) > 0.95
    assert max(cut.categories, key=cut.categories.__getitem__) == category
    lined = shop_picture(category).copy()
    extension_lines(ImageDraw.Draw(lined))
    assert mask_overlap(cut_out(lined.convert("RGBA")).mask, truth) > 0.97


def test_clean_pictures_have_no_marks():
    for category in ("cars", "chairs"):
        assert clean_cut(category).confidence == 1
        for path in sample_images(category):
            assert cut_out(read_rgba(path)).confidence == 1


def test_a_second_object_is_no_mark():
    """Large pieces are kept if they are detected, or if nothing is."""
    picture = Image.new("RGB", (200, 100), "white")
    pen = ImageDraw.Draw(picture)
    pen.rectangle((10, 20, 80, 80), "red")
    pen.rectangle((120, 30, 180, 80), "blue")
    foreground = np.asarray(picture).min(-1) < 128
    assert not find_marks(picture, foreground, ()).any()
    boxes = ((0.05, 0.2, 0.4, 0.8), (0.6, 0.3, 0.9, 0.8))
    detections = tuple(Detection(box, {"cars": 0.6, "chairs": 0.1}) for box in boxes)
    assert not find_marks(picture, foreground, detections).any()
    assert find_marks(picture, foreground, detections[:1])[50, 150]
    assert find_marks(picture, foreground[:, :100], ()) is None


@pytest.mark.parametrize(
    ("name", "category"),
    [("car_badge", "cars"), ("car_arrows", "cars"), ("chair_arrows", "chairs"), ("chair_mark", "chairs")],
)
def test_shop_pictures_that_once_failed_are_cut_out(shared: Path, name: str, category: str):
    """The object is a sample at 2.8 times its size, in the middle."""
    cut = cut_out(read_rgba(shared / f"failing/6/N28_{name}.png"))
    clean = cut_out(read_rgba(shared / f"failing/6/N28_{category[:-1]}_arrows.png"))
    assert mask_overlap(cut.mask, clean.mask) > 0.97
    assert max(cut.categories, key=cut.categories.__getitem__) == category
    rows, columns = np.nonzero(cut.mask)
    assert (rows.min() > 200) and (rows.max() < 500) and (columns.min() > 180) and (columns.max() < 540)
