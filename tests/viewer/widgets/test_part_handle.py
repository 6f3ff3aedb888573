"""The clicked part in the real window."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from imgui_bundle import ImVec2, imgui

from core.edits.paint import PartPaint
from core.models.part_head import PartHead
from tests.viewer.driver import Drive, Driver, in_window
from tests.viewer.stand_ins import endless_fit, two_parts
from viewer.services.backend import Backend


def _rest_on(window: Driver, offset: float) -> None:
    """Move the mouse beside the middle of the object, by a fraction of the view's shorter side, and below handles."""
    low, high = window.context.view
    card = window.session.viewport.settings.covered
    side = min(high - low)
    camera = window.editor.scene.camera
    x = (low.x + high.x) / 2 + (0.2 * math.sin(camera.azimuth) + offset) * side
    y = (low.y + high.y - card) / 2 + (0.2 * math.sin(camera.elevation) + 0.08) * side
    window.ctx.mouse_move_to_pos((x, y))


def _light_up(window: Driver, offset: float) -> None:
    window.wait_for_view()
    _rest_on(window, offset)
    window.ctx.mouse_click(0)
    window.wait(lambda: window.exists("View/handle"))


def _click_name(window: Driver) -> None:
    """Click the name above the handle."""
    box = window.ctx.item_info("//View/handle").rect_full
    window.ctx.mouse_move_to_pos((box.get_center().x, box.min.y - imgui.get_text_line_height()))
    window.ctx.mouse_click(0)
    window.ctx.yield_(3)


@in_window(part_map=two_parts)
def test_a_clicked_part_has_a_handle_that_reshapes_in_one_step(window: Driver) -> None:
    editor = window.editor
    unshaped = editor.state
    past = len(editor.history.past)
    _rest_on(window, 0.05)
    window.ctx.sleep(0.5)
    assert not window.exists("View/handle")
    _light_up(window, 0.05)
    window.drag("View/handle", 0, -60)
    window.wait()
    assert editor.scene.instance.codes.factors[:2] == (1.0, 1.0) and editor.scene.instance.codes.factors[2] > 1.1
    camera = editor.scene.camera  # nearer by what the larger object is scaled down in images
    assert replace(camera, distance=unshaped.scene.camera.distance) == unshaped.scene.camera
    assert len(editor.history.past) == past + 1
    window.undo()
    assert editor.state == unshaped


@in_window(part_map=two_parts)
def test_a_handle_says_when_the_object_can_follow_no_further(window: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    reshaping = window.session.reshaping
    labels = set[tuple[bool, str]]()

    def note(low: ImVec2, text: str, pad: ImVec2) -> None:
        labels.add((reshaping.is_past_end, text.split(": ")[-1]))

    monkeypatch.setattr("viewer.widgets.part_handle.paint_on_plate", note)
    _light_up(window, 0.05)
    window.drag("View/handle", 0, -20)
    window.wait()
    assert {text for past, text in labels if past} == set()
    _light_up(window, 0.05)
    window.drag("View/handle", 0, -4000)
    window.wait()
    assert {text for past, text in labels if past} == {"height 900 cm, no further"}
    assert window.editor.scene.instance.codes.factors[2] == pytest.approx(10.0)


@in_window(part_map=two_parts)
def test_a_drag_beside_the_handle_turns_the_object(window: Driver) -> None:
    first_scene = window.editor.scene
    azimuths = [first_scene.camera.azimuth]
    _light_up(window, 0.05)
    box = window.ctx.item_info("//View/handle").rect_full
    for x, y in ((imgui.get_mouse_pos().x, imgui.get_mouse_pos().y), (box.get_center().x, box.min.y - 15)):
        _light_up(window, 0.05)
        window.ctx.mouse_move_to_pos((x, y))  # on the part, and on its name
        window.ctx.mouse_drag_with_delta((80, 0))
        window.ctx.yield_(2)
        azimuths.append(window.editor.scene.camera.azimuth)
        window.editor.set_camera(first_scene.camera)
    assert window.editor.scene.instance is first_scene.instance
    assert max(azimuths[1:]) < azimuths[0]


@in_window(part_map=lambda *inputs: two_parts(*inputs, is_outer=False))
def test_a_part_in_the_middle_of_the_object_has_its_colours_and_no_handle(window: Driver) -> None:
    past = len(window.editor.history.past)
    _rest_on(window, 0.05)
    window.ctx.mouse_click(0)
    window.wait(lambda: window.session.reshaping.parts is not None)
    handle = window.session.reshaping.parts.map.handles[1]
    assert not window.exists("View/handle") and len(window.editor.history.past) == past
    low, high = window.context.view
    x, y = window.session.reshaping.parts.place_of(handle)
    window.ctx.mouse_move_to_pos((low.x + x * (high.x - low.x), low.y + y * (high.y - low.y) - 25))
    window.ctx.mouse_click(0)
    window.ctx.yield_(3)
    assert window.exists("$FOCUSED/###swatch 1")


def test_a_click_on_the_name_opens_the_colours_of_its_part(drive: Drive, backend: Backend) -> None:
    model = backend.load_model("chairs")
    head = PartHead(("seat", "back"), torch.zeros(2, model.field.config.width), torch.zeros(2))
    headed = replace(model, part_head=head)

    def act(window: Driver) -> None:
        unpainted = window.editor.scene.instance
        for offset, part_name in ((0.05, "back"), (-0.05, "seat")):
            _light_up(window, offset)
            assert window.session.painting.part == part_name  # which a swatch of the panel would paint
            _click_name(window)
            assert window.editor.scene.instance is unpainted
            assert window.exists("$FOCUSED/###swatch 1")
            window.ctx.popup_close_all()
        _light_up(window, 0.05)
        _click_name(window)
        window.click("$FOCUSED/###swatch 3")
        window.wait()
        assert torch.equal(window.editor.scene.instance.codes.shape, unpainted.codes.shape)
        assert window.editor.scene.instance.codes.of_kind(PartPaint) != unpainted.codes.of_kind(PartPaint)

    drive(act, replace(backend, load_model=lambda name: headed, part_map=two_parts))


@in_window(part_map=two_parts, fit=endless_fit)
def test_no_part_lights_up_during_a_fit_or_with_a_tool(window: Driver, photo: Path) -> None:
    _light_up(window, 0.05)
    window.context.tool = "wipe"
    window.ctx.yield_(5)
    assert not window.exists("View/handle")
    window.context.tool = "turn"
    window.context.drop([str(photo)])
    window.wait(lambda: window.session.viewport.source == "fit")
    _rest_on(window, 0.06)
    window.ctx.mouse_click(0)
    window.ctx.yield_(20)
    assert not window.exists("View/handle")
    assert window.session.reshaping.parts is None


@in_window(part_map=two_parts)
def test_wheel_and_pan_work_over_a_part_s_handle(window: Driver) -> None:
    _light_up(window, 0.05)
    _zoom_and_pan_over(window, "View/handle", lambda: _light_up(window, 0.05))


@in_window()
def test_wheel_and_pan_work_over_a_handle_of_the_size(window: Driver) -> None:
    window.show("Sliders")
    window.click("Sliders/**/###size handles")
    names = [f"View/##size {axis} {direction}" for axis in range(3) for direction in (-1, 1)]
    window.wait(lambda: any(map(window.exists, names)))
    _zoom_and_pan_over(window, next(filter(window.exists, names)), lambda: None)


def _zoom_and_pan_over(window: Driver, name: str, light_up: Callable[[], None]) -> None:
    viewport = window.session.viewport
    for button in (imgui.MouseButton_.middle, imgui.MouseButton_.right):
        window.ctx.mouse_move(f"//{name}")
        pan = viewport.settings.pan
        window.ctx.mouse_down(button)
        window.ctx.mouse_move_to_pos(imgui.get_mouse_pos() + imgui.ImVec2(40, 20))
        window.ctx.mouse_up(button)
        moved = viewport.settings.pan
        assert moved[0] > pan[0] + 0.03 and moved[1] > pan[1] + 0.01
        viewport.change(pan=(0.0, 0.0))
        window.wait()
        light_up()
    window.ctx.mouse_move(f"//{name}")
    distance = viewport.camera.distance
    window.ctx.mouse_wheel_y(2.0)
    assert viewport.camera.distance < distance
