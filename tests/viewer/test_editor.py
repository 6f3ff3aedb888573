from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from core.edits.stretch import Stretch
from core.models.codes import CodeBook
from core.models.model import Model
from core.models.photo_detail import PhotoDetail, PhotoView
from tests.conftest import open_models, random_model
from tests.viewer.stand_ins import shifted
from viewer.editor import Editor
from viewer.session import Session
from viewer.values import orbit
from viewer.values.direction import Direction
from viewer.values.objects import EditableObject
from viewer.values.project import Project


def test_every_edit_can_be_undone_and_redone(session: Session, editor: Editor, tmp_path: Path, model: Model) -> None:
    session.editor.scene.save(tmp_path / "saved.json")
    edits = (
        lambda: editor.set_camera(orbit.dragged(editor.scene.camera, 0.2, 0.1)),
        lambda: editor.show_object("object 2"),
        lambda: editor.set_b("object 4"),
        lambda: editor.mix_both(0.2, 0.3),
        lambda: editor.edit(Direction.principal(model.codes, "shape", 1).moved(editor.scene.instance, 2.0)),
        lambda: editor.edit(editor.scene.instance.with_edits(Stretch, Stretch((1.0, 1.5, 1.0)))),
        lambda: editor.sample(),
        lambda: editor.reset(),
        lambda: session.viewport.reset_view(),
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


def test_a_size_keeps_the_views_scale_and_is_reset(editor: Editor) -> None:
    initial_state = editor.state
    for width in (1.1, 1.3, 1.6):
        editor.edit(editor.scene.instance.with_edits(Stretch, Stretch((width, 1.0, 1.0))), gesture="size")
    editor.end_gesture()
    assert editor.state.change_from(initial_state) == "size"
    scene = editor.scene
    _, depth, height = scene.instance.codes.proportions
    assert depth == height
    assert depth / scene.camera.distance == pytest.approx(1 / initial_state.scene.camera.distance)  # as large on screen
    editor.undo()
    assert editor.state == initial_state
    editor.redo()
    editor.edit(editor.scene.instance.natural)
    assert editor.scene.instance == initial_state.scene.instance
    assert editor.scene.camera.distance == pytest.approx(initial_state.scene.camera.distance)


def test_shape_and_texture_slide_from_a_to_b_independently(editor: Editor) -> None:
    editor.show_object("object 1")
    editor.set_b("object 2")
    a = editor.objects["object 1"].instance
    b = editor.objects["object 2"].instance
    assert editor.scene.instance == a
    editor.mix_both(1.0, 0.0)
    torch.testing.assert_close(editor.scene.instance.codes.shape, b.codes.shape)
    assert torch.equal(editor.scene.instance.codes.texture, a.codes.texture)
    editor.mix_both(1.0, 0.5)
    torch.testing.assert_close(editor.scene.instance.codes.texture, (a.codes.texture + b.codes.texture) / 2)
    torch.testing.assert_close(editor.scene.instance.codes.shape, b.codes.shape)


def test_a_mix_begins_with_the_edited_object(editor: Editor) -> None:
    editor.show_object("object 1")
    edited = editor.scene.instance.codes.texture + 0.1
    editor.edit(editor.scene.instance.changed(texture=edited))
    for amount in (0.1, 0.6, 0.0):
        editor.mix_both(amount, amount, gesture="pad")
    assert torch.equal(editor.scene.instance.codes.texture, edited)
    editor.mix_both(0.5, 0.5)
    b = editor.objects[editor.state.mix.b].instance
    torch.testing.assert_close(editor.scene.instance.codes.texture, (edited + b.codes.texture) / 2)
    editor.show_object("object 1")
    assert editor.unmixed == editor.objects["object 1"].instance


def test_another_b_replaces_the_mixed_codes(editor: Editor) -> None:
    editor.show_object("object 1")
    editor.mix_both(0.0, 1.0)
    editor.set_b("object 3")
    torch.testing.assert_close(editor.scene.instance.codes.texture, editor.objects["object 3"].instance.codes.texture)
    assert torch.equal(editor.scene.instance.codes.shape, editor.objects["object 1"].instance.codes.shape)


def test_a_model_of_no_objects_has_its_mean(model: Model) -> None:
    empty = replace(model, codes=CodeBook(model.codes.shapes, model.codes.textures, ()))
    editor = Editor(open_models(empty), empty, torch.Generator())
    assert editor.objects.families == {empty.fingerprint: {"mean": ()}}
    assert editor.scene.instance == empty.mean


def fitted(model: Model) -> EditableObject:
    """An object with what its photo adds to its colours."""
    instance = model[1]
    rgba = np.full((20, 20, 4), 255, np.uint8)
    rgba[5:15, 5:15, 1:3] = 0
    camera = model.camera(0.5, 0.2).resized(20, 20)
    detail = PhotoDetail((PhotoView.of(rgba, camera),), instance.codes.shape, instance.codes.texture)
    return EditableObject("fitted", instance.with_detail(detail), True, 0.9)


def test_the_photo_s_detail_is_an_edit_and_stays_with_the_shape(editor: Editor, model: Model) -> None:
    chair = fitted(model)
    editor.add_and_show(chair, editor.scene.camera)
    initial_state = editor.state
    for strength in (0.8, 0.5, 1.0, 0.25):
        editor.set_detail(replace(chair.instance.detail, strength=strength), gesture="photo detail")
    editor.end_gesture()
    detail = editor.scene.instance.detail
    assert detail is not None and detail.strength == 0.25
    editor.edit(Direction.principal(model.codes, "texture", 0).moved(editor.scene.instance, 1.0))
    assert editor.scene.instance.detail is detail
    editor.show_object("object 2")
    assert editor.scene.instance.detail is None
    editor.show_object("fitted")
    assert editor.scene.instance.detail == detail  # as it was left
    for _ in range(4):
        editor.undo()
    assert editor.state == initial_state


def test_a_fitted_object_is_first_seen_from_its_photo(editor: Editor, model: Model) -> None:
    name = editor.objects.add(chair := fitted(model))
    editor.show_object(name)
    assert orbit.same_direction(editor.scene.camera, chair.instance.detail.views[0].camera)
    editor.set_camera(turned := orbit.turned(editor.scene.camera, 1.0, 0.0))
    for next_name in ("object 2", name):
        editor.show_object(next_name)
        assert editor.scene.camera == turned


def test_a_paint_keeps_a_camera_beyond_the_reach_of_zoom(editor: Editor, model: Model) -> None:
    """As a photo's camera may be."""
    editor.set_camera(replace(editor.scene.camera, distance=20 * model.distance))
    camera = editor.scene.camera
    editor.edit(editor.scene.instance.with_texture(model[3]))
    assert editor.scene.camera == camera


def test_esc_ends_a_turn_of_the_camera_and_drops_a_drag_of_an_edit(editor: Editor) -> None:
    scene = editor.scene
    turned = replace(scene.camera, azimuth=scene.camera.azimuth + 0.5)
    editor.set_camera(turned, gesture="orbit")
    editor.cancel_gesture()
    assert editor.scene.camera == turned and not editor.history.gesture
    steps = len(editor.history.steps)
    editor.edit(scene.instance.with_edits(Stretch, Stretch((1.0, 1.0, 1.5))), gesture="size box")
    editor.cancel_gesture()
    assert editor.scene.instance == scene.instance and len(editor.history.steps) == steps


def test_a_mix_stays_as_a_version_of_a_when_another_object_is_shown(editor: Editor, model: Model) -> None:
    name = editor.add_and_show(fitted(model), editor.scene.camera)
    editor.set_b("object 4")
    editor.mix_both(0.5, 0.25)
    mixed = editor.scene.instance
    editor.show_object("object 2")
    assert [editor.objects[version].instance for version in editor.objects.versions(name)][1:] == [mixed]
    editor.mix_both(0.5, 0.25)  # of an object that keeps no edits
    editor.show_object(name)
    assert len(editor.objects.versions(name)) == 2


def test_an_object_keeps_its_edits_when_its_fit_is_improved(editor: Editor, model: Model) -> None:
    chair = replace(fitted(model), key="7")
    name = editor.add_and_show(chair, editor.scene.camera)
    editor.edit(shifted(editor.scene.instance, 1.0))
    edited = editor.scene.instance
    better = replace(chair, instance=shifted(chair.instance, 0.1), confidence=0.95)
    assert not editor.improve(name, better, editor.scene.camera)
    assert editor.scene.instance == editor.objects[name].instance == edited
    assert editor.objects[name].confidence == 0.95
    editor.show_object(editor.objects.version(name, better.instance))
    assert editor.scene.instance == better.instance
    editor.undo()
    assert editor.scene.instance == editor.objects[name].instance == edited


@pytest.mark.parametrize("end", ("show again", "show another", "reset", "add", "undo and redo"))
def test_an_object_keeps_the_edits_of_a_drag_that_another_choice_ends(editor: Editor, model: Model, end: str) -> None:
    name = editor.add_and_show(fitted(model), editor.scene.camera)
    editor.edit(shifted(editor.scene.instance, 1.0), gesture="paint")
    edited = editor.scene.instance
    if end == "show again":
        editor.show_object(name)
    elif end == "show another":
        editor.show_object("object 3")
    elif end == "reset":
        editor.reset()
        name = editor.objects.versions(name)[1]
    elif end == "add":
        editor.add_and_show(fitted(model), editor.scene.camera)
    else:
        editor.undo()
        editor.redo()
    assert editor.objects[name].instance == edited


def test_edits_of_an_object_here_and_in_a_project_are_both_within_reach(model: Model) -> None:
    def shown(texture: float) -> Editor:
        editor = Editor(open_models(model), model, torch.Generator())
        editor.add_and_show(chair, editor.scene.camera)
        if texture:
            editor.edit(editor.scene.instance.changed(texture=chair.instance.codes.texture + texture))
        return editor

    chair = replace(fitted(model), key="7")
    for texture_here, texture_there in ((1.0, 2.0), (1.0, 0.0), (0.0, 2.0)):
        saved = shown(texture_there)
        editor = shown(texture_here)
        editor.restore(Project(saved.history, saved.objects.ever_added))
        assert editor.objects.own == ["fitted"]
        assert editor.objects["fitted"].original == chair.instance
        assert editor.objects["fitted"].instance == editor.scene.instance == saved.scene.instance
        edited = shifted(chair.instance, texture_here)
        states = [chair.instance, *({editor.scene.instance} - {chair.instance})]
        assert editor.objects.states("fitted") == states + ([edited] if texture_here else [])


@pytest.fixture
def both(model: Model) -> Editor:
    """Chairs, and cars whose objects have the same names."""
    cars = replace(random_model(seed=5), category="cars")
    return Editor(open_models(model, cars), model, torch.Generator().manual_seed(7))


def test_objects_of_two_models_are_edited_in_one_history(both: Editor, model: Model) -> None:
    _, cars = both.models
    both.set_b("object 4")
    both.show_object("object 2 (2)")
    assert both.model is cars and both.scene.instance == cars[2]
    assert both.state.mix.b == "object 1 (2)" or both.objects[both.state.mix.b].instance.model is cars
    both.mix_both(0.0, 0.5)
    both.sample()
    assert both.scene.instance.fingerprint == cars.fingerprint
    both.show_object("object 3")
    assert both.model is model and both.state.mix.b == "object 4"
    for _ in range(4):
        both.undo()
    assert both.model is model
    both.go_to(3)
    assert both.model is cars


def test_objects_of_two_models_are_not_mixed_and_bring_mixes_of_their_own(both: Editor) -> None:
    _, cars = both.models
    both.show_object("object 4 (2)")
    assert all(both.objects[name].instance.model is cars for name in both.state.mix.names)
    both.mix_both(0.0, 0.5)
    assert both.model is cars
    both.show_object("object 3")
    assert both.is_mixable("object 2") and not both.is_mixable("object 2 (2)")
    with pytest.raises(ValueError, match="different models"):
        both.set_b("object 2 (2)")
        both.mix_both(0.5, 0.5)
