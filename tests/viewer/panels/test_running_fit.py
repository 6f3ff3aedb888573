from pathlib import Path

import pytest
from imgui_bundle import imgui

from tests.viewer.driver import Driver, in_window
from tests.viewer.stand_ins import endless_fit


@in_window(fit=endless_fit)
def test_the_view_is_turned_around_a_growing_fit_and_follow_returns(window: Driver, photo: Path) -> None:
    viewport = window.session.viewport
    window.context.drop([str(photo)])
    window.wait(lambda: viewport.source == "fit")
    window.drag("View/orbit", 120)
    assert viewport.following
    assert viewport.turned
    assert viewport.source == "fit"
    assert window.editor.scene.camera.azimuth != pytest.approx(1.0, abs=0.1)
    window.ctx.yield_(3)
    window.click("Library/**/waits block.png")
    assert not viewport.turned
    window.wait(lambda: viewport.full_frame[1].camera.azimuth == pytest.approx(1.0))
    window.press(imgui.Key.r)  # another shape and texture
    assert viewport.source == "scene"
    window.click("Library/**/waits block.png")
    window.wait(lambda: viewport.source == "fit")
    window.fitting.stop()
    window.wait()
    assert window.editor.state.mix.a.shape == "block"
