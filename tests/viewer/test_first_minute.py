"""The first minute of README, with the shipped models: from the launch to the film of an object that was edited."""

import time
from collections.abc import Callable
from pathlib import Path

import av
import pytest
from imgui_bundle import ImVec2, imgui

from tests.viewer.driver import Drive, Driver
from tests.viewer.machine import slowness
from viewer.services.backend import Backend

_ACTIONS, _SECONDS = 6, 60.0


@pytest.fixture(autouse=True)
def _no_saliency_network() -> None:
    """A person's first photo is cut out by it."""


def _drag_the_dot(window: Driver) -> None:
    """Drag the dot of the mix pad from the corner of A to the right."""
    pad = window.ctx.item_info("//Mix/mix pad").rect_full
    inset = (pad.max.x - pad.min.x) / 10
    dot = ImVec2(pad.min.x + inset, pad.max.y - inset)
    window.ctx.mouse_move_to_pos(dot)
    window.ctx.mouse_down(0)
    window.ctx.mouse_move_to_pos(dot + ImVec2(3 * inset, 0))
    window.ctx.mouse_up(0)


@pytest.mark.slow
def test_a_photo_becomes_an_edited_turntable_in_a_minute(
    drive: Drive, shared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CODENERF_THREADS")  # it computes on every core, as the program does
    film = tmp_path / "police.mp4"
    waits = dict[str, float]()

    def act(window: Driver) -> None:
        def wait(what: str, until: Callable[[], bool]) -> None:
            began = time.monotonic()
            while not until():  # at the rate of a window on screen: without a display it would take all it can get
                window.ctx.yield_()
                time.sleep(1 / window.app.rate())
                assert time.monotonic() - began < 600, f"waited in vain for {what}"
            waits[what] = time.monotonic() - began

        context = window.context
        session = window.session
        window.drag("View/orbit", 60)  # 1
        assert window.exists("View/**/sample cushion")  # to turn makes nothing: the samples stay
        context.drop([str(shared / "photos" / "police.jpg")])  # 2
        wait("photo", lambda: session.fitting.history.photo is not None)
        wait("fit", lambda: not session.fitting.running)
        assert context.session.editor.objects.own == ["police"]
        window.show("Mix")  # 3
        _drag_the_dot(window)  # 4
        assert context.session.editor.state.mix.shape > 0.2
        window.press(imgui.Key.mod_ctrl, imgui.Key.e)  # 5
        window.click("Share/###film")
        window.click("Share/###save")  # 6
        window.type(str(film))
        wait("export", lambda: not context.session.exporting.running and film.exists())
        assert session.messages.errors == []

    drive(act, Backend())
    with av.open(str(film)) as video:
        assert video.streams.video[0].frames >= 36
    print(f"{_ACTIONS} actions; s waited: { {what: round(seconds, 1) for what, seconds in waits.items()} }")
    assert sum(waits.values()) < _SECONDS * slowness()
