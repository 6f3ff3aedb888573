"""The part under the mouse in the real window."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from imgui_bundle import imgui

from core.editing.parts import Handle
from core.edits.paint import PartPaint
from core.models.part_head import PartHead
from tests.viewer.driver import Drive, Driver, in_window
from tests.viewer.stand_ins import endless_fit, two_parts
from viewer.context import PanelContext
from viewer.services.backend import Backend
from viewer.widgets.part_handle import PartHandle


def _rest_on(window: Driver, across: float) -> None:
    """Move the mouse beside the middle of the object, by a fraction of the view's shorter side, and below handles."""
    low, high = window.context.view
    card = window.session.viewport.settings.covered
    side = min(high - low)
    camera = window.session.editor.scene.camera
    x = (low.x + high.x) / 2 + (0.2 * math.sin(camera.azimuth) + across) * side
    y = (low.y + high.y - card) / 2 + (0.2 * math.sin(camera.elevation) + 0.08) * side
    window.ctx.mouse_move_to_pos((x, y))


def _rest_until_lit(window: Driver, across: float) -> None:
    _rest_on(window, across)
    window.wait(lambda: window.exists("View/handle"))


@in_window(part_map=two_parts)
def test_the_part_under_the_mouse_has_a_handle_that_reshapes_in_one_step(window: Driver) -> None:
    editor = window.session.editor
    before = editor.state
    past = len(editor.history.past)
    assert not window.exists("View/handle")
    _rest_until_lit(window, 0.05)
    assert window.exists("View/part name")
    window.drag("View/handle", 0, -60)
    window.wait()
    assert editor.scene.instance.codes.factors[:2] == (1.0, 1.0) and editor.scene.instance.codes.factors[2] > 1.1
    camera = editor.scene.camera  # nearer by what the larger object is scaled down in images
    assert replace(camera, distance=before.scene.camera.distance) == before.scene.camera
    assert len(editor.history.past) == past + 1
    window.undo()
    assert editor.state == before


@in_window(part_map=two_parts)
def test_a_handle_says_when_the_object_can_follow_no_further(window: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    editor, reshaping = window.session.editor, window.session.reshaping
    labels = set[tuple[bool, str]]()
    label = PartHandle._label

    def noted(self: PartHandle, context: PanelContext, handle: Handle) -> str:
        text = label(self, context, handle)
        labels.add((reshaping.is_past_end, text.split(": ")[-1]))
        return text

    monkeypatch.setattr(PartHandle, "_label", noted)
    _rest_until_lit(window, 0.05)
    window.drag("View/handle", 0, -20)
    window.wait()
    assert {text for past, text in labels if past} == set()
    _rest_until_lit(window, 0.05)
    window.drag("View/handle", 0, -4000)
    window.wait()
    assert {text for past, text in labels if past} == {"height 900 cm, no further"}
    assert editor.scene.instance.codes.factors[2] == pytest.approx(10.0)


@in_window(part_map=two_parts)
def test_a_drag_elsewhere_on_a_lit_part_turns_the_object(window: Driver) -> None:
    editor = window.session.editor
    before = editor.scene
    _rest_until_lit(window, 0.05)
    window.ctx.mouse_drag_with_delta((80, 0))
    window.ctx.yield_(2)
    assert editor.scene.instance is before.instance
    assert editor.scene.camera.azimuth < before.camera.azimuth


def test_a_click_on_the_handle_opens_the_colours_of_its_part(drive: Drive, backend: Backend) -> None:
    model = backend.load_model("chairs")
    head = PartHead(("seat", "back"), torch.zeros(2, model.field.config.width), torch.zeros(2))
    headed = replace(model, part_head=head)

    def act(window: Driver) -> None:
        editor = window.session.editor
        before = editor.scene.instance
        for across, part in ((0.05, "back"), (-0.05, "seat")):
            _rest_until_lit(window, across)
            window.click("View/handle" if part == "back" else "View/part name")
            assert window.session.painting.part == part
            assert editor.scene.instance is before
            assert window.exists("$FOCUSED/###swatch 1")
            window.ctx.popup_close_all()
        _rest_until_lit(window, 0.05)
        window.click("View/handle")
        window.click("$FOCUSED/###swatch 3")
        window.wait()
        assert torch.equal(editor.code("shape"), before.codes.shape)
        assert editor.scene.instance.codes.of_kind(PartPaint) != before.codes.of_kind(PartPaint)

    drive(act, replace(backend, load_model=lambda name: headed, part_map=two_parts))


@in_window(part_map=two_parts, fit=endless_fit)
def test_no_part_lights_up_during_a_fit_or_with_a_tool(
    window: Driver, photo: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("viewer.widgets.part_handle._REST", 0.0)
    _rest_until_lit(window, 0.05)
    window.context.tool = "wipe"
    window.ctx.yield_(5)
    assert not window.exists("View/handle")
    window.context.tool = "turn"
    window.wait(lambda: window.exists("View/handle"))
    window.context.drop([str(photo)])
    window.wait(lambda: window.session.viewport.source == "fit")
    _rest_on(window, 0.06)
    window.ctx.yield_(20)
    assert not window.exists("View/handle")
    assert window.session.reshaping.parts is None


@in_window(part_map=two_parts)
def test_wheel_and_pan_work_over_a_part_s_handle(window: Driver) -> None:
    _rest_until_lit(window, 0.05)
    _zoom_and_pan_over(window, "View/handle", lambda: _rest_until_lit(window, 0.05))


@in_window()
def test_wheel_and_pan_work_over_a_handle_of_the_size(window: Driver) -> None:
    window.show("Sliders")
    window.click("Sliders/**/###size handles")
    names = [f"View/##size {axis} {way}" for axis in range(3) for way in (-1, 1)]
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
