import pytest

from viewer.screen.theme import DARK, LIGHT, ON_PLATE, PLATE, WARM, Palette, colours, contrast, emphasised, mixed, on

_READABLE = 4.5
"""The contrast that WCAG 2 asks of text."""


_GROUNDS = (
    "window_bg", "popup_bg", "menu_bar_bg", "title_bg_active", "frame_bg", "frame_bg_hovered", "frame_bg_active",
    "button", "button_hovered", "button_active", "header", "header_hovered", "header_active", "tab", "tab_hovered",
    "tab_selected", "tab_dimmed", "tab_dimmed_selected", "plot_histogram",
)  # fmt: skip


@pytest.mark.parametrize("palette", [DARK, LIGHT])
def test_every_text_has_contrast_to_its_background(palette: Palette) -> None:
    by_name = colours(palette)
    worst = {name: contrast(by_name["text"], by_name[name]) for name in _GROUNDS}
    worst |= {
        f"quiet {name}": contrast(palette.quiet, by_name[name]) for name in ("window_bg", "popup_bg", "menu_bar_bg")
    }
    assert {name: value for name, value in worst.items() if value < _READABLE} == {}
    for ground in (palette.panel, palette.back, palette.raised):
        assert contrast(palette.text, ground) > _READABLE
    for ground in (palette.panel, colours(palette)["popup_bg"]):
        for colour in (palette.quiet, palette.warm, palette.error):
            assert contrast(colour, ground) > _READABLE
    for badge in (palette.accent, WARM):
        assert contrast(on(badge), emphasised(badge)) > contrast(on(badge), badge) > _READABLE
    for ground in palette.background:  # through a plate that is not quite opaque
        assert contrast(ON_PLATE, mixed(PLATE, ground, 0.12)) > 2 * _READABLE


def test_borders_of_light_widgets_are_seen() -> None:
    assert contrast(LIGHT.line, LIGHT.panel) > 1.8
    assert contrast((0, 0, 0), (1, 1, 1)) == pytest.approx(21)
