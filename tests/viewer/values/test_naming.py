import numpy as np
import pytest

from viewer.values.naming import Image, colour_word, height_word, new_colour_word
from viewer.values.paints import rgb


def painted(*paints: str, height: int = 20, width: int = 20) -> Image:
    """An object in stripes of paints, as in an image with a white margin."""
    image = np.full((40, 40, 3), 255, np.uint8)
    opacity = np.zeros((40, 40), np.float32)
    for paint, rows in zip(paints, np.array_split(np.arange(height), len(paints)), strict=True):
        image[rows[0] : rows[-1] + 1, :width] = [round(255 * channel) for channel in rgb(paint)]
    opacity[:height, :width] = 1.0
    return image, opacity


@pytest.mark.parametrize(
    ("paint", "word"),
    [
        *(("#f2f2ee", "white"), ("#6d7277", "grey"), ("#1b1c1f", "black"), ("#c3202a", "red"), ("#6f1520", "dark red")),
        *(("#e2701c", "orange"), ("#f0c22b", "yellow"), ("#2f7d43", "green"), ("#1f4432", "dark green")),
        *(("#2566b8", "blue"), ("#1b2c55", "dark blue"), ("#cdbb9c", "beige"), ("#6a4029", "brown")),
        *(("#d79a9a", "pink"), ("#73408c", "purple"), ("#3aa6a6", "turquoise")),
    ],
)
def test_paints_have_their_names(paint: str, word: str) -> None:
    assert colour_word(*painted(paint)) == word


def test_the_body_names_a_car_not_its_windows() -> None:
    assert colour_word(*painted("#c3202a", "#c3202a", "#1b1c1f", "#1b1c1f", "#1b1c1f")) == "red"
    assert colour_word(*painted("#c3202a")[:1], np.zeros((40, 40), np.float32)) == ""


def test_the_paint_of_a_part_names_a_version_though_it_tints_the_rest() -> None:
    before = painted("#d79a62", "#d79a62", "#d79a62", "#c3202a")
    assert new_colour_word(before, painted("#c2a060", "#c2a060", "#c2a060", "#2566b8")) == "blue"
    assert new_colour_word(before, before) == ""


@pytest.mark.parametrize(("height", "word"), [(20, "low"), (30, ""), (39, "tall")])
def test_an_object_is_low_or_tall_among_those_of_its_category(height: int, word: str) -> None:
    assert height_word(painted("#c3202a", height=height)[1], "chairs") == word
    assert height_word(painted("#c3202a", height=height)[1], "boats") == ""
