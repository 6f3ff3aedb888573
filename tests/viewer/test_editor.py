from dataclasses import replace
from pathlib import Path

import pytest
import torch

from core.models.codes import CodeBook
from core.models.model import Model
from viewer.editor import Editor
from viewer.session import Session
from viewer.values import orbit
from viewer.values.direction import Direction
from viewer.values.part import PARTS
from viewer.workspace import Workspace


def test_every_edit_can_be_undone_and_redone(
    session: Session, editor: Editor, workspace: Workspace, tmp_path: Path, model: Model
) -> None:
    workspace.exporting.scene(tmp_path / "saved.json")
    edits = (
        lambda: editor.set_camera(orbit.dragged(editor.scene.camera, 0.2, 0.1)),
        lambda: editor.show_object("object 2"),
        lambda: editor.set_b("object 4"),
        lambda: editor.mix("shape", 0.5),
        lambda: editor.mix("texture", 0.7),
        lambda: editor.mix_both(0.2, 0.3),
        lambda: editor.take("texture", "object 3"),
        lambda: editor.swap(),
        lambda: editor.move_along(Direction.principal(model.codes, "shape", 1), 2.0),
        lambda: editor.set_directions((Direction.principal(model.codes, "texture", 0),)),
        lambda: editor.sample("texture"),
        lambda: editor.scale_to_distance("shape", 0.5),
        lambda: editor.set_to_mean("shape"),
        lambda: editor.reset_to_object("texture"),
        lambda: workspace.viewport.reset_view(),
        lambda: workspace.player.add_key(),
        lambda: workspace.player.change(turns=2),
        lambda: session.open_scene(tmp_path / "saved.json"),
    )
    states = [editor.state]
    for edit in edits:
        edit()
        assert editor.state != states[-1]
        states.append(editor.state)
    for state in states[-2::-1]:
        editor.undo()
        assert editor.state == state
    for state in states[1:]:
        editor.redo()
        assert editor.state == state


def test_a_drag_is_one_step(editor: Editor, model: Model) -> None:
    before, direction = editor.state, Direction.principal(model.codes, "shape", 0)
    for number in range(20):
        editor.move_along(direction, 0.1 * number + 0.05, gesture="shape 0")
    editor.end_gesture()
    editor.undo()
    assert editor.state == before


def test_a_direction_moves_alone(editor: Editor, model: Model) -> None:
    before = editor.space("shape").coordinates(editor.code("shape"))
    editor.move_along(Direction.principal(model.codes, "shape", 2), -1.5)
    after = editor.space("shape").coordinates(editor.code("shape"))
    expected = before.clone()
    expected[2] = -1.5
    torch.testing.assert_close(after, expected, atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(editor.code("texture"), editor.objects["object 0"].codes.texture)


def test_shape_and_texture_slide_from_a_to_b_independently(editor: Editor) -> None:
    editor.show_object("object 1")
    editor.set_b("object 2")
    a, b = editor.objects["object 1"].codes, editor.objects["object 2"].codes
    assert editor.scene.codes == a
    editor.mix("shape", 1.0)
    torch.testing.assert_close(editor.code("shape"), b.shape)
    assert torch.equal(editor.code("texture"), a.texture)
    editor.mix("texture", 0.5)
    torch.testing.assert_close(editor.code("texture"), (a.texture + b.texture) / 2)
    torch.testing.assert_close(editor.code("shape"), b.shape)


def test_shape_and_texture_are_taken_from_different_objects(editor: Editor) -> None:
    one, two = editor.objects["object 1"].codes, editor.objects["object 2"].codes
    editor.show_object("object 3")
    editor.mix_both(0.5, 0.5)
    editor.take("shape", "object 1")
    assert torch.equal(editor.code("shape"), one.shape)
    assert (editor.state.mix.a, editor.state.mix.shape) == (("object 1", "object 3"), 0.0)
    assert editor.state.mix.texture == 0.5
    editor.take("texture", "object 2")
    assert torch.equal(editor.code("texture"), two.texture)
    editor.swap()
    assert editor.state.mix.a == ("object 2", "object 1")
    torch.testing.assert_close(editor.code("shape"), two.shape)
    torch.testing.assert_close(editor.code("texture"), one.texture)
    editor.move_along(Direction.principal(editor.model.codes, "shape", 0), 1.0)
    editor.reset_to_object("shape")
    assert torch.equal(editor.code("shape"), two.shape)


def test_what_is_locked_stays_whatever_is_picked(editor: Editor) -> None:
    editor.show_object("object 1")
    editor.mix_both(0.5, 0.5)
    editor.lock("shape", True)
    shape, mix = editor.code("shape"), editor.state.mix
    edits = (
        lambda: editor.show_object("object 2"),
        lambda: editor.sample("shape"),
        lambda: editor.take("shape", "object 3"),
        lambda: editor.take("texture", "object 3"),
        lambda: editor.mix_both(0.9, 0.9),
        lambda: editor.swap(),
        lambda: editor.set_to_mean("shape"),
    )
    for edit in edits:
        edit()
        assert torch.equal(editor.code("shape"), shape)
        assert (editor.state.mix.a.shape, editor.state.mix.shape) == (mix.a.shape, mix.shape)
    assert editor.state.mix.texture == 0.9
    editor.lock("shape", False)
    editor.show_object("object 2")
    assert editor.scene.codes == editor.objects["object 2"].codes


def test_a_code_is_brought_back_straight_towards_the_mean(editor: Editor) -> None:
    editor.show_object("object 2")
    name, away = editor.nearest("shape") or ("", 1.0)
    assert (name, away) == ("object 2", pytest.approx(0, abs=1e-5))
    space, before, history = editor.space("shape"), editor.code("shape"), editor.history
    for to in (0.9, 0.01, 0.5):
        editor.scale_to_distance("shape", to, gesture="pull shape")
        assert editor.distance("shape") == pytest.approx(to, rel=1e-3)
    direction = torch.nn.functional.cosine_similarity(editor.code("shape") - space.mean, before - space.mean, dim=0)
    assert float(direction) == pytest.approx(1, abs=1e-3)
    assert editor.nearest("texture") == ("object 2", pytest.approx(0, abs=1e-5))
    editor.undo()
    assert editor.state == history.now
    editor.set_to_mean("shape")
    editor.scale_to_distance("shape", 1.0)  # the mean has no direction
    assert editor.distance("shape") == pytest.approx(0, abs=1e-5)


def test_the_nearest_objects_are_searched_for_once_per_code(editor: Editor, monkeypatch: pytest.MonkeyPatch) -> None:
    searched = list[str]()
    for part in PARTS:
        search = getattr(CodeBook, f"nearest_{part}")
        counted = lambda book, code, part=part, search=search: searched.append(part) or search(book, code)  # noqa: E731
        monkeypatch.setattr(CodeBook, f"nearest_{part}", counted)
    for _ in range(3):
        assert [editor.nearest(part) for part in PARTS] == [("object 0", 0.0)] * 2
    assert searched == ["shape", "texture"]
    editor.take("texture", "object 3")
    editor.set_camera(orbit.dragged(editor.scene.camera, 0.2, 0.1))
    assert [editor.nearest(part) for part in PARTS] == [("object 0", 0.0), ("object 3", 0.0)]
    assert searched == ["shape", "texture", "texture"]


def test_another_b_takes_over_what_is_mixed_in(editor: Editor) -> None:
    editor.show_object("object 1")
    editor.mix("texture", 1.0)
    editor.set_b("object 3")
    torch.testing.assert_close(editor.code("texture"), editor.objects["object 3"].codes.texture)
    assert torch.equal(editor.code("shape"), editor.objects["object 1"].codes.shape)


def test_a_model_of_no_objects_has_its_mean(model: Model) -> None:
    empty = replace(model, codes=CodeBook(model.codes.shapes, model.codes.textures, ()))
    editor = Editor(empty, torch.Generator())
    assert editor.objects.names == ["mean"]
    assert editor.scene.codes == empty.codes.mean
    assert editor.nearest("shape") is None


def test_the_same_seed_samples_the_same(model: Model) -> None:
    sampled = []
    for _ in range(2):
        editor = Editor(model, torch.Generator().manual_seed(7))
        for part in PARTS:
            editor.sample(part)
        sampled.append(editor.scene.codes)
    assert sampled[0] == sampled[1]
