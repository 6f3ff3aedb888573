import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from imgui_bundle import imgui

from core.models.model import Model
from core.rendering.progressive import Frame, RenderJob
from tests.viewer.driver import Drive, Driver
from tests.viewer.stand_ins import quick_frames
from viewer.panels.sliders import SlidersPanel
from viewer.services.backend import Backend
from viewer.values.influence import CodeInfluence
from viewer.values.part import PARTS


def test_one_part_alone_can_be_shown(drive: Drive) -> None:
    def act(window: Driver) -> None:
        window.show("Sliders")
        for shown, there in (("Texture", "texture"), ("Shape", "shape"), ("All", "both")):
            window.click("Sliders/##parts")
            window.click(f"$FOCUSED/{shown}")
            window.ctx.yield_(2)
            for part in ("shape", "texture"):
                assert window.exists(f"Sliders/**/###Random {part}") == (there in (part, "both"))

    drive(act)


def test_sliders_move_one_direction_and_can_be_reset(drive: Drive) -> None:
    def act(window: Driver) -> None:
        editor = window.session.editor
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
        editor = window.session.editor
        before = editor.state
        window.show("Sliders")
        window.drag("Sliders/**/##shape 1", 70)
        assert editor.state != before
        assert editor.history.past == (before,)

    drive(act)


def test_strips_show_where_sliders_lead(drive: Drive, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        session, editor = window.session, window.session.editor
        window.show("Sliders")
        window.wait(lambda: session.thumbnails.count >= 6 and not session.jobs.busy())
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
        editor = window.session.editor
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
        editor = window.session.editor
        panel = next(panel for panel in window.app.panels if isinstance(panel, SlidersPanel))
        window.show("Sliders")
        window.click("Sliders/###strips")
        found: dict[str, CodeInfluence] = {}
        for part in PARTS:
            window.ctx.mouse_move(f"//Sliders/**/##{part} 1")
            window.wait(lambda: panel.influence is not None and panel.influence[0] == (part,))  # noqa: B023
            assert panel.influence is not None
            found[part] = panel.influence[1]
        assert found["texture"].leak == 0.0
        assert found["texture"].image.std() > 0
        assert found["shape"].leak > 0
        assert not editor.history.past

    drive(act, real_backend)


def test_what_a_slider_changes_is_of_renders_of_one_size(drive: Drive, backend: Backend) -> None:
    may_end, fine = threading.Event(), list[RenderJob]()

    def second_is_late(model: Model, job: RenderJob) -> Iterator[Frame | None]:
        if (job.camera.width, job.camera.height) == (96, 96):
            fine.append(job)
            while len(fine) > 1 and not may_end.is_set():
                time.sleep(0.01)
                yield None
        yield from quick_frames(model, job)

    def act(window: Driver) -> None:
        panel = next(panel for panel in window.app.panels if isinstance(panel, SlidersPanel))
        window.show("Sliders")
        window.click("Sliders/###strips")
        window.ctx.mouse_move("//Sliders/**/##shape 1")
        window.wait(lambda: len(fine) == 2)
        window.ctx.yield_(5)
        assert window.session.messages.errors == []
        assert panel.influence is not None
        assert len(panel.influence[1].image) == 32
        may_end.set()
        window.wait(lambda: len(panel.influence[1].image) == 96)

    drive(act, replace(backend, frames=second_is_late), strict=False)


def name_direction(window: Driver, button: str, name: str) -> None:
    """Ask for a name, and type it."""
    window.click(f"Sliders/**/###{button}")
    window.ctx.item_click("//**/##new name")
    window.ctx.key_chars_replace_enter(name)
    window.ctx.yield_(3)


def test_directions_are_named_moved_renamed_removed_and_last(drive: Drive, tmp_path: Path) -> None:
    folder, strengths = tmp_path / "config", list[float]()

    def first(window: Driver) -> None:
        editor = window.session.editor
        window.show("Sliders")
        name_direction(window, "name mix", "sportier")
        name_direction(window, "name texture 2", "darker")
        assert [(one.name, one.parts) for one in editor.state.directions] == [
            ("sportier", PARTS),
            ("darker", PARTS[1:]),
        ]
        before, (sportier, darker) = editor.scene.codes, editor.state.directions
        window.set("Sliders/**/##named 1", 1.25)
        assert editor.strength(sportier) == pytest.approx(1.25, abs=1e-3)
        assert not torch.equal(editor.code("shape"), before.shape)
        window.undo()
        assert editor.scene.codes == before
        window.click("Sliders/**/named 2 at 2")
        assert editor.strength(darker) == pytest.approx(2.0, abs=1e-3)
        assert editor.code("shape") is before.shape
        window.click("Sliders/**/##named 2", 1)
        assert editor.strength(darker) == pytest.approx(0.0, abs=1e-3)
        window.click("Sliders/**/###menu named 2")
        window.ctx.item_click("//**/##new name")
        window.ctx.key_chars_replace_enter("night blue")
        window.ctx.yield_(3)
        assert [one.name for one in editor.state.directions] == ["sportier", "night blue"]
        window.click("Sliders/**/###menu named 1")
        window.ctx.item_click("//**/###remove direction")
        window.ctx.yield_(3)
        assert [one.name for one in editor.state.directions] == ["night blue"]
        window.undo()
        assert [one.name for one in editor.state.directions] == ["sportier", "night blue"]
        strengths.extend(editor.strength(one) for one in editor.state.directions)
        window.menu("File/###save_project")
        window.type(str(tmp_path / "mine.codenerf"))

    def second(window: Driver) -> None:
        editor = window.session.editor
        assert [one.name for one in editor.state.directions] == ["sportier", "night blue"]
        assert [editor.strength(one) for one in editor.state.directions] == pytest.approx(strengths, abs=1e-4)
        window.menu("File/###new_project")
        window.show("Sliders")
        window.click("Sliders/**/###menu named 1")
        window.ctx.item_click("//**/###remove direction")
        window.menu("File/###new_project")
        assert [one.name for one in window.session.editor.state.directions] == ["night blue"]
        name_direction(window, "name shape 1", "wider")
        window.context.drop([str(tmp_path / "mine.codenerf")])
        window.wait()
        names = {one.name for one in window.session.editor.state.directions}
        assert names == {"sportier", "night blue", "wider"}

    drive(first, folder=folder)
    drive(second, folder=folder)


def test_the_way_between_equal_objects_has_no_name(drive: Drive) -> None:
    def act(window: Driver) -> None:
        editor = window.session.editor
        editor.set_b(editor.state.mix.a.shape)
        window.show("Sliders")
        name_direction(window, "name mix", "nothing")
        assert not editor.state.directions
        assert "both have the same shape and texture" in window.session.messages.errors[-1]

    drive(act)
