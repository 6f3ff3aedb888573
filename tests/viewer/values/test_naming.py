import pytest

from viewer.values.naming import colour_word
from viewer.values.paints import rgb


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
    assert colour_word(rgb(paint)) == word
