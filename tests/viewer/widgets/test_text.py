"""Captions of any text and length take a few measurements of the text."""

import pytest
from imgui_bundle import ImVec2, imgui

from tests.viewer.driver import Driver, in_window
from viewer.widgets.text import paint_caption, shortened

FOREIGN = "\udcff" * 90, "a\u0301" * 20_000, "\u202e\0\n" * 90, "data:image/png;base64," + "i" * 10**6


@in_window()
def test_a_caption_is_shortened_by_bisection(window: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    measured = list[int]()
    measure = imgui.calc_text_size

    def counted(text: str, *more: object) -> ImVec2:
        measured.append(len(text))
        return measure(text, *more)

    drawn = list[tuple[str, int, int]]()

    def draw() -> None:
        if drawn:
            return
        with monkeypatch.context() as patch:
            patch.setattr(imgui, "calc_text_size", counted)
            for words in ("ab" * 1_000_000, "stool", "W"):
                paint_caption(window.context, words, ImVec2(0, 0), 60.0)
                drawn.append((words, len(measured), max(measured)))
                measured.clear()

    calls = window.app.params.callbacks
    show_gui = calls.show_gui
    calls.show_gui = lambda: (show_gui(), draw())
    window.wait(lambda: bool(drawn))
    assert all(count < 15 and longest < 1000 for _, count, longest in drawn)


@in_window()
def test_foreign_text_fits_its_width(window: Driver) -> None:
    window.ctx.yield_()
    for text in FOREIGN:
        assert imgui.calc_text_size(shortened(text, 90)).x <= 90
