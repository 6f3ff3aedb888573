import numpy as np
import pytest
import torch
from imgui_bundle import ImVec2

from core.models.model import Model
from tests.viewer.driver import Drive, Driver


def test_objects_are_picked_and_mixed(drive: Drive, model: Model) -> None:
    def act(window: Driver) -> None:
        editor = window.session.editor
        window.click("Library/**/show object 2")
        window.choose("object 4", "Make it B")
        assert (editor.state.mix.a, editor.state.mix.b) == (("object 2", "object 2"), "object 4")
        assert editor.scene.codes == model.codes[2]
        window.set("Mix/##mix shape", 1.0)
        window.ctx.yield_(2)
        np.testing.assert_allclose(editor.code("shape"), model.codes[4].shape)
        np.testing.assert_allclose(editor.code("texture"), model.codes[2].texture)
        window.drag("Mix/##mix texture", 60)
        assert 0 < editor.state.mix.texture <= 1
        assert editor.state.mix.shape == 1.0
        past = len(editor.history.past)
        window.undo()
        assert editor.state.mix.texture == 0
        assert len(editor.history.past) == past - 1

    drive(act)


def test_the_pad_mixes_shape_across_and_texture_upwards(drive: Drive, model: Model) -> None:
    def act(window: Driver) -> None:
        editor = window.session.editor
        window.click("Library/**/show object 2")
        window.choose("object 4", "Make it B")
        before = editor.state
        pad = window.ctx.item_info("//Mix/mix pad").rect_full
        inset = (pad.max.x - pad.min.x) / 10
        dot = ImVec2(pad.min.x + inset, pad.max.y - inset)
        window.wait()
        assert window.session.thumbnails.count >= 25  # the mixes are seen before one drags
        window.ctx.mouse_move_to_pos(dot)  # the middle of the dot, in the corner of A
        window.ctx.mouse_down(0)
        window.ctx.yield_(2)
        assert (editor.state.mix.shape, editor.state.mix.texture) == pytest.approx((0, 0), abs=0.02)
        window.ctx.mouse_move_to_pos(dot + ImVec2(4 * inset, 0))
        assert editor.state.mix.shape == pytest.approx(0.5, abs=0.05)
        assert editor.state.mix.texture == pytest.approx(0, abs=0.02)
        window.ctx.mouse_up(0)
        window.undo()
        window.click("Mix/mix pad")
        assert editor.state.mix.shape == pytest.approx(0.5, abs=0.05)
        assert editor.state.mix.texture == pytest.approx(0.5, abs=0.05)
        middle = editor.state
        window.drag("Mix/mix pad", 300, 15)  # beyond its border
        mix = editor.state.mix
        assert mix.shape == 1.0
        assert 0 < mix.texture < middle.mix.texture
        assert editor.scene.codes == model.codes[2].mixed(model.codes[4], mix.shape, mix.texture)
        window.undo()
        assert editor.state == middle
        window.undo()
        assert editor.state == before

    drive(act)


def test_shape_and_texture_are_taken_from_different_thumbnails(drive: Drive, model: Model) -> None:
    def act(window: Driver) -> None:
        editor = window.session.editor
        window.drop("Library/**/show object 3", "Mix/slot shape")
        window.choose("object 2", "Take only its texture")
        assert editor.scene.codes == model.codes[3].taking("texture", model.codes[2])
        window.drop("Library/**/show object 5", "Mix/slot B")
        assert (editor.state.mix.a, editor.state.mix.b) == (("object 3", "object 2"), "object 5")
        window.click("Mix/###swap")
        assert editor.scene.codes == model.codes[2].taking("texture", model.codes[3])
        assert len(editor.history.past) == 4

    drive(act)


def test_what_is_locked_is_left_alone(drive: Drive, model: Model) -> None:
    def act(window: Driver) -> None:
        editor = window.session.editor
        window.click("Mix/###lock shape")
        window.click("Library/**/show object 2")
        window.drop("Library/**/show object 3", "Mix/slot shape")
        window.show("Sliders")
        window.click("Sliders/**/###Random texture")
        window.show("Mix")
        assert torch.equal(editor.code("shape"), model.codes[0].shape)
        assert len(editor.history.past) == 2
        window.click("Mix/###lock shape")
        window.drop("Library/**/show object 3", "Mix/slot shape")
        assert torch.equal(editor.code("shape"), model.codes[3].shape)

    drive(act)
