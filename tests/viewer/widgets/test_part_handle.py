from dataclasses import replace

import pytest
from imgui_bundle import imgui

from core.directions.grab import Pull
from core.geometry.camera import Camera
from core.models.model import Instance
from tests.viewer.driver import Drive, Driver
from viewer.services.backend import Backend
from viewer.values.direction import Direction


def test_the_shape_is_pulled_while_g_is_held(drive: Drive, backend: Backend) -> None:
    def pulls(instance: Instance, camera: Camera, point: tuple[float, float]) -> list[Pull]:
        assert point == pytest.approx((camera.width / 2, camera.height / 2), abs=2)
        return [Pull(2, 0.3, (0.0, -20.0))]

    def act(window: Driver) -> None:
        editor = window.session.editor
        direction, before = Direction.principal(editor.model.codes, "shape", 2), editor.state
        past, start = len(editor.history.past), editor.strength(direction)
        low, high = window.context.view
        card = window.session.viewport.settings.covered
        assert card > 50
        window.ctx.mouse_move_to_pos(((low.x + high.x) / 2, (low.y + high.y - card) / 2))  # the object's middle
        window.ctx.key_down(imgui.Key.g)
        window.wait(lambda: window.session.grabbing.pull is not None)
        window.ctx.mouse_drag_with_delta((0, -30))
        window.ctx.key_up(imgui.Key.g)
        assert editor.strength(direction) > start + 0.2
        assert editor.scene.camera == before.scene.camera
        assert len(editor.history.past) == past + 1
        window.undo()
        assert editor.state == before
        window.drag("View/orbit", 0, -30)  # without the key the object is turned
        assert editor.scene.instance == before.scene.instance
        assert editor.scene.camera != before.scene.camera

    drive(act, replace(backend, pulls=pulls))
