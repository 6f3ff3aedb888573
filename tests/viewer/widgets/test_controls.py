import time
from pathlib import Path

import pytest
from imgui_bundle import imgui

from tests.viewer.driver import Driver, in_window


@in_window(size=(900, 600))
def test_progress_shortens_the_name_and_keeps_the_numbers(window: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    exporting = window.session.exporting
    exporting.path = Path("a rocking chair of a long name-mesh.glb")
    exporting.progress = 0.3
    exporting._began = time.monotonic() - 30, 0.0
    texts = list[str]()
    draw = imgui.progress_bar

    def recorded(fraction: float, size: tuple[float, float], text: str) -> None:
        texts.append(text)
        draw(fraction, size, text)
        assert imgui.calc_text_size(text).x < imgui.get_item_rect_size().x

    monkeypatch.setattr(imgui, "progress_bar", recorded)
    window.context.set_preference(text=1.3)
    window.ctx.yield_(3)
    assert texts and texts[-1].startswith("30%   70 s left   a")
