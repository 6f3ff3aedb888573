from pathlib import Path

import pytest
import torch
from imgui_bundle import imgui

from core.models.codes import CODE_KINDS
from tests.viewer.driver import Driver, in_window
from viewer.panels.sliders import SlidersPanel
from viewer.values.direction import Direction
from viewer.values.influence import CodeInfluence


@in_window()
def test_sliders_with_words_move_one_direction_and_are_reset(window: Driver) -> None:
    editor = window.session.editor
    window.show("Sliders")
    window.wait()
    before = editor.state
    assert not window.exists("Sliders/**/##shape 2")  # it has no word
    direction = Direction.principal(editor.model.codes, "shape", 0)
    low, high = direction.reach(editor.scene.instance)
    window.set("Sliders/**/##shape 1", low + 0.2)
    window.wait()
    assert editor.strength(direction) == pytest.approx(low + 0.2, abs=1e-3)
    window.set("Sliders/**/##shape 1", 9.0)
    window.wait()
    assert editor.strength(direction) == pytest.approx(high, abs=1e-3)  # a soft stop
    window.click("Sliders/**/##shape 1", 1)
    assert editor.strength(direction) == pytest.approx((low + high) / 2, abs=1e-3)
    assert editor.scene.instance.codes.texture is before.scene.instance.codes.texture
    past = len(editor.history.past)
    window.drag("Sliders/**/##texture 1", 70)
    window.wait()
    assert editor.state.scene.instance != before.scene.instance
    assert len(editor.history.past) == past + 1  # a drag is one step
    window.click("Sliders/**/##texture 1", 1)
    assert editor.model.codes.texture_space.coordinates(editor.code("texture"))[0] == pytest.approx(0, abs=1e-4)
    window.click("Sliders/###reset")
    assert editor.scene.instance == before.scene.instance
    window.click("Sliders/###sample")
    while editor.history.past:
        window.undo()
    assert editor.state == before


@in_window()
def test_a_size_is_typed_dragged_and_undone(window: Driver) -> None:
    editor = window.session.editor
    sizing = window.session.sizing
    window.show("Sliders")
    window.wait(lambda: sizing.bounds is not None)
    before = editor.state
    natural = sizing.bounds.size
    assert natural == pytest.approx((60, 45, 90))
    for name, side in (("Width", 72.0), ("Depth", 45.0), ("Height", 99.0)):
        window.set(f"Sliders/**/##{name}", side)
        window.ctx.yield_(2)
    assert editor.scene.instance.codes.stretch == pytest.approx((1.2, 1.0, 1.1))
    window.click("Sliders/**/###natural size")
    assert editor.scene.instance == before.scene.instance
    past = len(editor.history.past)
    window.drag("Sliders/**/##Width", 40)
    assert editor.scene.instance.codes.stretch[0] > 1.1
    assert len(editor.history.past) == past + 1  # a drag is one step
    window.undo()
    assert editor.scene.instance == before.scene.instance


@in_window()
def test_a_click_on_a_size_is_for_typing(window: Driver) -> None:
    editor = window.session.editor
    window.show("Sliders")
    window.wait(lambda: window.session.sizing.bounds is not None)
    window.click("Sliders/**/##Width")
    window.ctx.key_chars_replace("72")
    window.ctx.key_press(imgui.Key.enter)
    window.ctx.yield_(2)
    assert editor.scene.instance.codes.stretch == pytest.approx((1.2, 1.0, 1.0))


@in_window()
def test_the_sides_of_the_box_are_dragged(window: Driver) -> None:
    editor = window.session.editor
    window.show("Sliders")
    window.wait(lambda: window.session.sizing.bounds is not None)
    before = editor.state
    assert not window.exists("View/**/##size 2 1")
    window.click("Sliders/**/###size handles")
    window.ctx.yield_(2)
    window.drag("View/**/##size 2 1", 0, -40)
    assert editor.scene.instance.codes.stretch[2] > 1.1
    assert editor.scene.instance.codes.stretch[:2] == (1.0, 1.0)
    window.undo()
    assert editor.state == before
    window.drag("View/orbit", 60, 0)
    assert editor.scene.instance == before.scene.instance  # beside the handles, the object turns
    editor.lock("shape", True)
    window.ctx.yield_(2)
    assert not window.exists("View/**/##size 2 1")  # nothing resizes a locked shape
    editor.edit(before.scene.instance.changed(stretch=(1.5, 1.0, 1.0)))
    assert editor.scene.instance == before.scene.instance
    window.press(imgui.Key.escape)
    assert window.context.tool == "turn"


@in_window()
def test_the_slider_under_the_mouse_shows_where_it_leads(window: Driver) -> None:
    session = window.session
    window.show("Sliders")
    window.wait()
    before = len(session.thumbnails.newest)
    window.ctx.mouse_move("//Sliders/**/##shape 1")
    window.wait(lambda: len(session.thumbnails.newest) >= before + 3)
    assert not session.editor.history.past


@in_window()
def test_a_random_object_keeps_what_is_locked(window: Driver) -> None:
    editor = window.session.editor
    before = editor.scene.instance
    window.show("Sliders")
    window.click("Sliders/###lock texture")
    window.click("Sliders/###sample")
    assert not torch.equal(editor.code("shape"), before.codes.shape)
    assert torch.equal(editor.code("texture"), before.codes.texture)
    window.click("Sliders/###lock texture")
    window.ctx.mouse_move("//View/orbit")
    window.press(imgui.Key.r)
    assert not torch.equal(editor.code("texture"), before.codes.texture)
    assert len(editor.history.past) == 2


@in_window(fixture="real_backend")
def test_the_slider_under_the_mouse_shows_what_it_changes(window: Driver, tmp_path: Path) -> None:
    editor = window.session.editor
    panel = next(panel for panel in window.app.panels if isinstance(panel, SlidersPanel))
    window.show("Sliders")
    window.wait()
    influences: dict[str, CodeInfluence] = {}
    for kind in CODE_KINDS:
        window.ctx.mouse_move(f"//Sliders/**/##{kind} 1")
        window.wait(lambda: panel.influence not in (None, *influences.values()))
        assert panel.influence is not None
        influences[kind] = panel.influence
    assert influences["texture"].leak == 0.0
    assert influences["texture"].image.std() > 0
    assert influences["shape"].leak > 0
    assert not editor.history.past
