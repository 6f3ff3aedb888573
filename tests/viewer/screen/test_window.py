from pathlib import Path

import pytest
from imgui_bundle import glfw_utils, hello_imgui

import glfw  # isort: skip

from tests.viewer.driver import Drive, Driver
from viewer.screen import window

_LAYOUT = """;;;<<<AppWindow>>>;;;
[AppWindow]
DpiWindowSizeFactor={dpi}
WindowPosition={position}
WindowSize=1280,800
"""


@pytest.mark.parametrize(("position", "dpi"), [("5000,400", 1.0), ("-4000,-3000", 2.0)])
def test_a_window_whose_monitor_is_gone_opens_on_one_that_is_there(
    drive: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, position: str, dpi: float
) -> None:
    (tmp_path / "window.ini").write_text(_LAYOUT.format(position=position, dpi=3.0 - dpi))  # the other monitor's
    parameters = window.parameters

    def of_screen(size: tuple[int, int], folder: Path | None) -> hello_imgui.RunnerParams:
        params = parameters(size, folder)
        params.dpi_aware_params.dpi_window_size_factor = dpi
        return params

    monkeypatch.setattr(window, "parameters", of_screen)

    def act(driver: Driver) -> None:
        assert hello_imgui.dpi_window_size_factor() == dpi
        x, y = glfw.get_window_pos(glfw_utils.glfw_window_hello_imgui())
        left, top, width, height = glfw.get_monitor_workarea(glfw.get_primary_monitor())
        assert left - 50 < x < left + width - 200 and top - 50 < y < top + height - 200
        assert driver.session.messages.errors == []

    drive(act, folder=tmp_path)


def test_a_window_larger_than_its_monitor_shrinks(drive: Drive) -> None:
    def act(driver: Driver) -> None:
        window.resize(7680, 4320)
        window.limit_size()
        size = glfw.get_window_size(glfw_utils.glfw_window_hello_imgui())
        assert all(map(int.__le__, size, glfw.get_monitor_workarea(glfw.get_primary_monitor())[2:]))

    drive(act)
