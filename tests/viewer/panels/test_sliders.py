from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from imgui_bundle import ImVec2, imgui

from core.editing.bounds import Bounds, portion_of
from core.edits.bend import Bend
from core.models.codes import CODE_KINDS
from core.models.part_head import PartHead
from tests.viewer.driver import Driver, in_window, tooltip
from viewer.panels.sliders import SlidersPanel
from viewer.services.backend import Backend
from viewer.values.direction import Direction


def show_sizes(window: Driver) -> None:
    """Show the sliders, and wait until the object is measured."""
    window.show("Sliders")
    window.wait(lambda: window.session.reshaping.bounds is not None)


@in_window()
def test_sliders_with_words_move_one_direction_and_are_reset(window: Driver) -> None:
    window.show("Sliders")
    window.wait()
    unmoved = window.editor.state
    assert not window.exists("Sliders/**/##shape 2")  # it has no word
    direction = Direction.principal(window.editor.model.codes, "shape", 0)
    low, high = direction.reach(window.editor.scene.instance)
    window.set("Sliders/**/##shape 1", low + 0.2)
    window.wait()
    assert direction.strength(window.editor.scene.instance) == pytest.approx(low + 0.2, abs=1e-3)
    window.set("Sliders/**/##shape 1", 9.0)
    window.wait()
    assert direction.strength(window.editor.scene.instance) == pytest.approx(high, abs=1e-3)  # a soft stop
    assert window.editor.scene.instance.codes.texture is unmoved.scene.instance.codes.texture
    past = len(window.editor.history.past)
    window.drag("Sliders/**/##texture 1", 70)
    window.wait()
    assert window.editor.state.scene.instance != unmoved.scene.instance
    assert len(window.editor.history.past) == past + 1  # a drag is one step
    window.click("Sliders/###reset")
    assert window.editor.scene.instance == unmoved.scene.instance
    window.click("Sliders/###sample")
    while window.editor.history.past:
        window.undo()
    assert window.editor.state == unmoved


@in_window()
def test_a_size_is_typed_dragged_and_undone(window: Driver) -> None:
    reshaping = window.session.reshaping
    show_sizes(window)
    natural_state = window.editor.state
    natural = reshaping.bounds.size
    assert natural == pytest.approx((60, 45, 90))
    for name, side in (("Width", 72.0), ("Depth", 45.0), ("Height", 99.0)):
        window.set(f"Sliders/**/##{name}", side)
        window.ctx.yield_(2)
    assert window.editor.scene.instance.codes.factors == pytest.approx((1.2, 1.0, 1.1))
    window.click("Sliders/**/###natural size")
    assert window.editor.scene.instance == natural_state.scene.instance
    past = len(window.editor.history.past)
    window.drag("Sliders/**/##Width", 40)
    assert window.editor.scene.instance.codes.factors[0] > 1.1
    assert len(window.editor.history.past) == past + 1  # a drag is one step
    window.undo()
    assert window.editor.scene.instance == natural_state.scene.instance


@in_window()
def test_a_click_on_a_size_is_for_typing(window: Driver) -> None:
    show_sizes(window)
    window.click("Sliders/**/##Width")
    window.ctx.key_chars_replace("72")
    window.ctx.key_press(imgui.Key.enter)
    window.ctx.yield_(2)
    assert window.editor.scene.instance.codes.factors == pytest.approx((1.2, 1.0, 1.0))


@in_window()
def test_the_sides_of_the_box_are_dragged(window: Driver) -> None:
    show_sizes(window)
    natural_state = window.editor.state
    assert not window.exists("View/**/##size 2 1")
    window.click("Sliders/**/###size handles")
    window.ctx.yield_(2)
    window.drag("View/**/##size 2 1", 0, -40)
    assert window.editor.scene.instance.codes.factors[2] > 1.1
    assert window.editor.scene.instance.codes.factors[:2] == (1.0, 1.0)
    window.undo()
    assert window.editor.state == natural_state
    window.editor.set_camera(replace(window.editor.scene.camera, elevation=0.0))
    window.ctx.yield_(2)
    assert window.exists("View/**/##size 2 1")  # the top, also from below
    window.editor.undo()
    window.drag("View/orbit", 60, 0)
    assert window.editor.scene.instance == natural_state.scene.instance  # beside the handles, the object turns
    window.press(imgui.Key.escape)
    assert window.context.tool == "turn"


@pytest.fixture
def legged(backend: Backend) -> Backend:
    """Stand-ins whose model has chairs with a seat."""
    head = PartHead(("seat", "legs"), torch.zeros(2, 16), torch.zeros(2))
    model = replace(backend.load_model("chairs"), part_head=head)
    return replace(backend, load_model=lambda name: model)


@in_window("legged")
def test_legs_are_typed_dragged_and_undone(window: Driver) -> None:
    reshaping = window.session.reshaping
    legs = portion_of(window.editor.model)
    show_sizes(window)
    natural_state = window.editor.state

    def lengths() -> tuple[float, float]:
        """The legs and the height in cm."""
        codes = window.editor.scene.instance.codes
        bounds = reshaping.bounds.after(codes.edits_of("size"))
        return bounds.length(legs), bounds.size[2]

    assert lengths() == pytest.approx((36, 90))
    window.set("Sliders/**/##Legs", 48.0)
    window.ctx.yield_(2)
    assert lengths() == pytest.approx((48, 102), abs=0.01)
    assert len(window.editor.history.past) == 1 and window.editor.state.change_from(natural_state) == "size"
    window.set("Sliders/**/##Height", 51.0)
    window.ctx.yield_(2)
    assert lengths() == pytest.approx((24, 51), abs=0.01)
    window.click("Sliders/**/###natural size")
    assert window.editor.scene.instance == natural_state.scene.instance
    past = len(window.editor.history.past)
    window.drag("Sliders/**/##Legs", 40)
    assert lengths()[0] > 38 and lengths()[1] - lengths()[0] == pytest.approx(54)
    assert len(window.editor.history.past) == past + 1  # a drag is one step
    window.undo()
    assert window.editor.scene.instance == natural_state.scene.instance
    window.set("Sliders/**/##Legs", 1e5)  # as far as they go
    window.ctx.yield_(2)
    assert 100 < lengths()[0] < 1e4 and window.session.messages.errors == []


@in_window("legged")
def test_the_seats_line_is_dragged_with_the_mouse(window: Driver) -> None:
    show_sizes(window)
    window.set("Sliders/**/##Width", 65.0)  # with the first edit, the history covers a part of the view
    window.ctx.yield_(2)
    widened = window.editor.state

    def height() -> float:
        """The handle's px from the top."""
        return window.ctx.item_info("//View/**/##size legs").rect_full.get_center().y

    window.click("Sliders/**/###size handles")
    window.ctx.yield_(2)
    start = height()
    window.drag("View/**/##size legs", 0, -30)
    window.ctx.yield_(2)
    assert height() == pytest.approx(start - 30, abs=6)
    (bend,) = window.editor.scene.instance.codes.of_kind(Bend)
    assert bend.moved > bend.plane
    assert len(window.editor.history.past) == 2
    window.undo()
    assert window.editor.state == widened


@in_window()
def test_an_object_without_parts_has_no_field_for_legs(window: Driver) -> None:
    show_sizes(window)
    assert window.exists("Sliders/**/##Height") and not window.exists("Sliders/**/##Legs")


@in_window("legged", bounds=lambda instance: Bounds((-0.2, -0.15, -0.3), (0.2, 0.15, 0.3), 150.0))
def test_an_object_whose_legs_have_no_end_has_no_field_for_them(window: Driver) -> None:
    show_sizes(window)
    window.click("Sliders/**/###size handles")
    window.ctx.yield_(2)
    assert window.exists("View/**/##size 2 1") and not window.exists("View/**/##size legs")
    assert not window.exists("Sliders/**/##Legs")


@in_window()
def test_the_slider_under_the_mouse_shows_where_it_leads(window: Driver) -> None:
    window.show("Sliders")
    window.wait()
    thumbnail_count = len(window.session.thumbnails.newest()())
    window.ctx.mouse_move("//Sliders/**/##shape 1")
    window.wait(lambda: len(window.session.thumbnails.newest()()) >= thumbnail_count + 3)
    assert not window.editor.history.past
    assert tooltip(window) is not None
    slider = window.ctx.item_info("//Sliders/**/##shape 1").rect_full
    box = tooltip(window)
    assert box.pos.x >= window.context.view[1].x  # beside the object, whose pixels light up
    assert box.pos.y + box.size.y <= slider.min.y


@in_window()
def test_nothing_covers_what_a_pressed_slider_changed_until_the_mouse_has_left_it(window: Driver) -> None:
    window.show("Sliders")
    window.wait()

    def is_calm() -> bool:
        window.wait()
        window.ctx.sleep(1.0)
        return tooltip(window) is None and window.context.hints.overlay is None

    window.ctx.mouse_move("//Sliders/**/##shape 1")
    window.wait(lambda: tooltip(window) is not None and window.context.hints.overlay is not None)
    window.ctx.mouse_down(0)
    window.ctx.mouse_move_to_pos(imgui.get_mouse_pos() + ImVec2(20, 0))
    assert is_calm()
    window.ctx.mouse_up(0)
    assert is_calm()
    window.ctx.mouse_move("//View/orbit")
    window.ctx.mouse_move("//Sliders/**/##shape 1")
    window.wait(lambda: tooltip(window) is not None and window.context.hints.overlay is not None)


@in_window(fixture="real_backend")
def test_the_slider_under_the_mouse_shows_what_it_changes(window: Driver, tmp_path: Path) -> None:
    panel = next(panel for panel in window.app.panels if isinstance(panel, SlidersPanel))
    window.show("Sliders")
    window.wait()
    overlays = list[np.ndarray | None]([None])
    for kind in CODE_KINDS:
        window.ctx.mouse_move(f"//Sliders/**/##{kind} 1")
        window.wait(lambda: all(panel.influence is not overlay for overlay in overlays))
        overlays.append(panel.influence)
        assert panel.influence is not None and panel.influence.std() > 0
    assert not window.editor.history.past
