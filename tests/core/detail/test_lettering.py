"""Detection of lettering on drawn car sides, but not of lines and lamps."""

import numpy as np
import pytest
import torch
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from core.detail.lettering import lettering, with_lamps, without_lettering

SIDE = 512
MAP = 256
PAINTS = {"white": (235, 235, 240), "red": (150, 20, 25), "black": (25, 25, 30)}


def side_of_a_car(
    paint: tuple[int, int, int], word: str = "", ink: tuple[int, int, int] = (190, 130, 40)
) -> Image.Image:
    """A plain side with door gaps, a handle, a trim line, the edge of a window and a round lamp."""
    image = Image.new("RGB", (SIDE, SIDE), paint)
    draw = ImageDraw.Draw(image)
    draw.rectangle((60, 100, 450, 160), (30, 40, 45))
    for x in (150, 300):
        draw.line((x, 160, x, 340), (60, 60, 60), 3)
        draw.rectangle((x + 12, 180, x + 34, 187), (50, 50, 50))
    draw.line((40, 300, 470, 300), (70, 70, 70), 4)
    draw.ellipse((440, 220, 480, 260), (220, 220, 210), (120, 120, 120), 3)
    if word:
        draw.text((180, 225), word, ink, ImageFont.load_default(30))
    return image


def letters_in(image: Image.Image, flank: float = 1.0) -> Float[Tensor, "h w"]:
    photo = torch.from_numpy(np.array(image)).movedim(-1, 0) / 255
    paint = photo[:, 0, 0][:, None, None].expand(3, MAP, MAP)
    return lettering(photo, paint, torch.full((MAP, MAP), flank))


@pytest.mark.parametrize("word", ["POLICE", "TAXI", "Bakery", "0800 1234"])
@pytest.mark.parametrize(
    ("paint", "ink"), [("white", (190, 130, 40)), ("red", (240, 235, 220)), ("black", (250, 250, 250))]
)
def test_words_are_detected_and_nothing_beside_them(word: str, paint: str, ink: tuple[int, int, int]) -> None:
    plain = side_of_a_car(PAINTS[paint])
    written = side_of_a_car(PAINTS[paint], word, ink)
    strokes = torch.from_numpy((np.abs(np.array(plain, int) - np.array(written)) > 60).any(-1))
    letters = letters_in(written) > 0
    pixels = letters.repeat_interleave(2, 0).repeat_interleave(2, 1)
    assert float(pixels[strokes].float().mean()) > 0.97
    assert int(letters[:100].sum()) == int(letters[:, :75].sum()) == int(letters[:, 215:].sum()) == 0


@pytest.mark.parametrize("paint", PAINTS)
def test_gaps_handles_trim_and_lamps_are_not_taken_for_lettering(paint: str) -> None:
    assert not letters_in(side_of_a_car(PAINTS[paint])).any()


def test_lettering_is_detected_on_the_flank_alone() -> None:
    assert not letters_in(side_of_a_car(PAINTS["white"], "POLICE"), flank=0.0).any()


def test_lettering_is_detected_in_photos_of_any_size() -> None:
    image = side_of_a_car(PAINTS["white"], "POLICE")
    for size in ((1024, 1024), (400, 400), (1, 1), (700, 9), (9, 700)):
        assert bool(torch.isfinite(letters_in(image.resize(size))).all())
    assert letters_in(image.resize((1024, 1024))).any() and letters_in(image.resize((400, 400))).any()


def test_paint_replaces_lettering_and_stays_elsewhere() -> None:
    image = torch.full((3, 64, 64), 0.9)
    image[:, 20:40, 20:40] = 0.2
    letters = torch.zeros(64, 64)
    letters[18:42, 18:42] = 1
    clean, weight = without_lettering(image, letters, torch.ones(64, 64, dtype=torch.bool))
    result = torch.lerp(image, clean, weight)
    assert torch.allclose(result, torch.full_like(image, 0.9), atol=1e-3)
    assert weight[:10].max() == 0


def test_rough_places_at_a_cars_ends_are_lamps() -> None:
    """The left half of a grille is on the side of the car, and neither plain paint nor panes are lamps."""
    photo = torch.full((3, 64, 64), 0.8)
    photo[:, 20:40:2] = 0.4
    normals = torch.tensor([0.0, 1.0, 0.0]).repeat(64, 64, 1)
    normals[:, :32] = torch.tensor([1.0, 0.0, 0.0])
    glass = torch.zeros(64, 64)
    glass[:, 56:] = 1
    probabilities = {"body": 1 - glass, "glass": glass}
    lamps = with_lamps(probabilities, photo, normals)["lamps"]
    assert float(lamps[24:36, 32:56].min()) > 0.95
    assert not lamps[:14].any() and not lamps[:, :32].any() and not lamps[:, 56:].any()
    assert with_lamps({"seat": glass}, photo, normals) == {"seat": glass}
