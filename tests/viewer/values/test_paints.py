import pytest

from viewer.values.paints import as_paint, paints_of, rgb, square_colour


@pytest.mark.parametrize("part_name", ["body", "wheels", "fabric", "wood", "seat", "back", "arms", "legs", ""])
def test_every_part_has_twelve_different_paints(part_name: str) -> None:
    paints = paints_of(part_name)
    assert len(set(paints.values())) == len(paints) == 12
    assert all(as_paint(rgb(paint)) == paint for paint in paints.values())


@pytest.mark.parametrize("text", ["", "red", "#ff", "#FF0000zz", "#gggggg"])
def test_a_damaged_paint_is_black(text: str) -> None:
    assert rgb(text) == (0.0, 0.0, 0.0)


def test_the_square_has_greys_at_the_left_and_hues_from_white_to_black() -> None:
    assert square_colour(0.05, 0.5) == pytest.approx((0.5, 0.5, 0.5))
    red, green, blue = square_colour(0.1, 0.5)
    assert red > 0.9 > 0.1 > green == pytest.approx(blue)
    for hue in (0.0, 0.5, 1.0):
        assert square_colour(hue, 0.0) == pytest.approx((1.0, 1.0, 1.0))
        assert square_colour(hue, 1.0) == pytest.approx((0.0, 0.0, 0.0))
