import pytest
from imgui_bundle import ImVec2, imgui

from core.models.model import Model
from tests.viewer.driver import Driver, in_window
from viewer.values.state import Mix


@in_window()
def test_b_is_chosen_in_the_library_or_dropped(window: Driver) -> None:
    window.click("Library/**/show object 2")
    window.choose("object 4", "Make it B")
    assert (window.editor.state.mix.a, window.editor.state.mix.b) == (("object 2", "object 2"), "object 4")
    window.drop("Library/**/show object 5", "Mix/slot B")
    assert (window.editor.state.mix.a, window.editor.state.mix.b) == (("object 2", "object 2"), "object 5")


@in_window()
def test_the_keyboard_reaches_every_mix(window: Driver) -> None:
    key = imgui.Key

    def mix() -> Mix:
        return window.editor.state.mix

    window.click("Mix/slot B")
    for pressed in (*[key.down_arrow] * 5, key.space):
        window.press(pressed)  # from B down to the pad's second row from below
    shape = mix().shape
    texture = mix().texture
    assert texture == 0.25
    window.press(key.right_arrow)
    window.press(key.space)
    assert (mix().shape, mix().texture) == (shape + 0.25, texture)


@in_window()
def test_a_drag_after_a_key_is_not_lost(window: Driver) -> None:
    window.click("Mix/slot B")
    window.press(imgui.Key.down_arrow)
    assert imgui.get_io().nav_visible
    corner = window.ctx.item_info("//Mix/slot B").rect_full.get_bl()
    window.ctx.mouse_move_to_pos(corner + ImVec2(60, 60))
    window.drag("Mix/mix pad", 60, 0)
    assert window.editor.state.mix.shape > 0.5


@in_window()
def test_the_pad_mixes_shape_across_and_texture_upwards(window: Driver, model: Model) -> None:
    editor = window.editor
    window.click("Library/**/show object 2")
    window.choose("object 4", "Make it B")
    unmixed = editor.state
    pad = window.ctx.item_info("//Mix/mix pad").rect_full
    inset = (pad.max.x - pad.min.x) / 10
    dot = ImVec2(pad.min.x + inset, pad.max.y - inset)
    window.wait()
    assert len(window.session.thumbnails.newest()()) >= 25  # the mixes are seen before one drags
    window.ctx.mouse_move_to_pos(dot)  # the middle of the dot, in the corner of A
    window.ctx.mouse_down(0)
    window.ctx.yield_(2)
    assert (editor.state.mix.shape, editor.state.mix.texture) == pytest.approx((0, 0), abs=0.02)
    window.ctx.mouse_move_to_pos(dot + ImVec2(4 * inset, 0))
    assert editor.state.mix.shape == pytest.approx(0.5, abs=0.05)
    assert editor.state.mix.texture == pytest.approx(0, abs=0.02)
    window.press(imgui.Key.escape)
    window.ctx.mouse_move_to_pos(dot + ImVec2(5 * inset, 0))  # still held: the drag is over
    assert editor.state.mix == unmixed.mix
    window.ctx.mouse_up(0)
    assert editor.state == unmixed and not editor.history.gesture
    assert editor.history.states[-1] is editor.state and unmixed.scene == editor.state.scene  # nothing to redo
    window.click("Mix/mix pad")
    assert editor.state.mix.shape == pytest.approx(0.5, abs=0.05)
    assert editor.state.mix.texture == pytest.approx(0.5, abs=0.05)
    middle = editor.state
    window.drag("Mix/mix pad", 300, 15)  # beyond its border
    mix = editor.state.mix
    assert mix.shape == 1.0
    assert 0 < mix.texture < middle.mix.texture
    assert editor.scene.instance == model[2].mixed(model[4], mix.shape, mix.texture)
    window.undo()
    assert editor.state == middle
    window.undo()
    assert editor.state == unmixed
