import math
from pathlib import Path

import pytest
from imgui_bundle import imgui

from tests.viewer.driver import Drive, Driver
from viewer.values import orbit


def test_usual_views_have_keys_and_the_camera_has_numbers(drive: Drive, photo: Path, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        session, editor = window.session, window.session.editor
        window.show("Camera")
        window.ctx.mouse_move("//View/orbit")
        for key, view in ((imgui.Key._1, "front"), (imgui.Key._2, "side"), (imgui.Key.keypad3, "top")):
            window.press(key)
            assert (editor.scene.camera.azimuth, editor.scene.camera.elevation) == orbit.VIEWS[view]
        window.click("Camera/###see_front")
        past = len(editor.history.past)
        window.set("Camera/##azimuth", 30.0)
        window.set("Camera/##elevation", -12.5)
        window.set("Camera/##distance", 2.5)
        window.ctx.yield_(2)
        camera = editor.scene.camera
        assert (math.degrees(camera.azimuth), math.degrees(camera.elevation)) == pytest.approx((30.0, -12.5))
        assert camera.distance == pytest.approx(2.5)
        assert len(editor.history.past) == past + 1  # moves of the camera are one step
        window.press(imgui.Key._4)  # no photo yet
        assert editor.scene.camera == camera
        window.context.drop([str(photo)])
        window.wait(lambda: not session.fitting.running)
        window.wait()
        found = editor.scene.camera
        window.click("Camera/###see_side")
        window.press(imgui.Key._4)
        assert editor.scene.camera == found

    drive(act)


def test_the_camera_is_copied_pasted_and_without_perspective(drive: Drive) -> None:
    def act(window: Driver) -> None:
        session, editor = window.session, window.session.editor
        window.show("Camera")
        window.drag("View/orbit", 90, -20)
        here = editor.scene.camera
        window.click("Camera/###copy_camera")
        window.click("View/###reset_view")
        window.click("Camera/###paste_camera")
        back = editor.scene.camera
        assert (back.azimuth, back.elevation) == pytest.approx((here.azimuth, here.elevation), abs=1e-5)
        imgui.set_clipboard_text("no camera at all")
        window.click("Camera/###paste_camera")
        assert editor.scene.camera == back
        assert "no camera" in window.session.messages.errors[0]
        window.ctx.mouse_move("//View/orbit")
        window.press(imgui.Key._5)
        assert session.orthographic
        window.press(imgui.Key._1)
        assert (editor.scene.camera.azimuth, session.orthographic) == (orbit.VIEWS["front"][0], True)
        window.click("Camera/###orthographic")
        assert not session.orthographic

    drive(act)
