from imgui_bundle import imgui

from tests.viewer.driver import Driver, in_window
from viewer.widgets.text import shortened

FOREIGN = "\udcff" * 90, "a\u0301" * 20_000, "\u202e\0\n" * 90, "data:image/png;base64," + "i" * 10**6


@in_window()
def test_foreign_text_fits_its_width(window: Driver) -> None:
    window.ctx.yield_()
    for text in FOREIGN:
        assert imgui.calc_text_size(shortened(text, 90)).x <= 90
