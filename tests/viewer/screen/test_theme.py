import pytest

from viewer.screen.theme import DARK, LIGHT, ON_PLATE, PLATE, WARM, Palette, contrast, mixed, on

_READABLE = 4.5
"""The contrast that WCAG 2 asks of text."""


@pytest.mark.parametrize("palette", [DARK, LIGHT])
def test_text_can_be_read_on_whatever_it_is_on(palette: Palette) -> None:
    for ground in (palette.panel, palette.back, palette.raised):
        assert contrast(palette.text, ground) > _READABLE
    for colour in (palette.quiet, palette.warm, palette.error):
        assert contrast(colour, palette.panel) > _READABLE
    for badge in (palette.accent, WARM):
        assert contrast(on(badge), badge) > _READABLE
    for ground in palette.background:  # through a plate that is not quite opaque
        assert contrast(ON_PLATE, mixed(PLATE, ground, 0.12)) > 2 * _READABLE


def test_borders_of_light_widgets_are_seen() -> None:
    assert contrast(LIGHT.line, LIGHT.panel) > 1.8
    assert contrast((0, 0, 0), (1, 1, 1)) == pytest.approx(21)
