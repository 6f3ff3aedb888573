from pathlib import Path

import numpy as np
import pytest
import torch
from imgui_bundle import imgui

from tests.viewer.driver import Drive, Driver
from viewer.panels.sliders import SlidersPanel
from viewer.services.backend import Backend
from viewer.values.history import PARTS
from viewer.values.influence import CodeInfluence


def test_one_part_alone_can_be_shown(drive: Drive) -> None:
    def act(window: Driver) -> None:
        window.show("Sliders")
        for shown, there in (("Texture", "texture"), ("Shape", "shape"), ("Shape and texture", "both")):
            window.click("Sliders/##parts")
            window.click(f"$FOCUSED/{shown}")
            window.ctx.yield_(2)
            for part in ("shape", "texture"):
                assert window.exists(f"Sliders/**/###Random {part}") == (there in (part, "both"))

    drive(act)


def test_sliders_move_one_direction_and_can_be_reset(drive: Drive) -> None:
    def act(window: Driver) -> None:
        editor = window.workspace.editor
        window.show("Sliders")
        before = editor.state
        window.set("Sliders/**/##shape 2", 1.5)
        window.ctx.yield_(2)
        moved = editor.space("shape").coordinates(editor.code("shape"))
        assert moved[1] == pytest.approx(1.5, abs=1e-3)
        assert editor.scene.codes.texture is before.scene.codes.texture
        window.drag("Sliders/**/##texture 1", 40)
        assert editor.state.scene.codes != before.scene.codes
        window.click("Sliders/**/##texture 1", 1)
        assert editor.space("texture").coordinates(editor.code("texture"))[0] == pytest.approx(0, abs=1e-4)
        window.click("Sliders/**/Mean##shape")
        np.testing.assert_allclose(editor.code("shape"), editor.space("shape").mean)
        window.click("Sliders/**/Reset##shape")
        np.testing.assert_allclose(editor.code("shape"), before.scene.codes.shape)
        window.click("Sliders/**/###Random texture")
        while editor.history.past:
            window.undo()
        assert editor.state == before

    drive(act)


def test_dragging_a_slider_is_one_step(drive: Drive) -> None:
    def act(window: Driver) -> None:
        editor = window.workspace.editor
        before = editor.state
        window.show("Sliders")
        window.drag("Sliders/**/##shape 1", 70)
        assert editor.state != before
        assert editor.history.past == (before,)

    drive(act)


def test_strips_show_where_sliders_lead(drive: Drive, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        session, workspace, editor = window.session, window.workspace, window.workspace.editor
        window.show("Sliders")
        window.wait(lambda: workspace.thumbnails.count >= 6 and not session.jobs.busy())
        before = editor.scene.codes
        window.click("Sliders/**/shape 1 at 2")
        assert editor.space("shape").coordinates(editor.code("shape"))[0] == pytest.approx(2.0, abs=1e-3)
        assert editor.scene.codes.texture is before.texture
        window.click("Sliders/**/shape 1 at 0")
        assert editor.space("shape").coordinates(editor.code("shape"))[0] == pytest.approx(0.0, abs=1e-3)
        window.click("Sliders/###strips")
        window.ctx.yield_(2)
        assert not window.exists("Sliders/**/shape 1 at 2")

    drive(act)


def test_a_random_object_keeps_what_is_locked(drive: Drive) -> None:
    def act(window: Driver) -> None:
        editor = window.workspace.editor
        before = editor.scene.codes
        window.click("Mix/###lock texture")
        window.show("Sliders")
        window.click("Sliders/###sample_all")
        assert not torch.equal(editor.code("shape"), before.shape)
        assert torch.equal(editor.code("texture"), before.texture)
        window.show("Mix")
        window.click("Mix/###lock texture")
        window.ctx.mouse_move("//View/orbit")
        window.press(imgui.Key.r)
        assert not torch.equal(editor.code("texture"), before.texture)
        assert len(editor.history.past) == 2

    drive(act)


def test_the_slider_under_the_mouse_shows_what_it_changes(drive: Drive, real_backend: Backend, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        editor = window.workspace.editor
        panel = next(panel for panel in window.app.panels if isinstance(panel, SlidersPanel))
        window.show("Sliders")
        window.click("Sliders/###strips")
        found: dict[str, CodeInfluence] = {}
        for part in PARTS:
            window.ctx.mouse_move(f"//Sliders/**/##{part} 1")
            window.wait(lambda: panel.influence is not None and panel.influence[0] == part)  # noqa: B023
            assert panel.influence is not None
            found[part] = panel.influence[1]
        assert found["texture"].leak == 0.0
        assert found["texture"].image.std() > 0
        assert found["shape"].leak > 0
        assert not editor.history.past

    drive(act, real_backend)
