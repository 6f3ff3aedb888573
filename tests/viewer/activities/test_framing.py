from dataclasses import replace

import pytest

from core.edits.stretch import Stretch
from tests.viewer.driver import finish
from tests.viewer.test_editor import fitted
from viewer.editor import Editor
from viewer.session import Session
from viewer.values import orbit


@pytest.fixture
def nearer(session: Session) -> Session:
    """The object fills its share at a distance of 1.1, whichever it is."""
    session.jobs.backend = replace(session.jobs.backend, distance=lambda *inputs: 1.1)
    return session


def test_a_chosen_object_is_framed_as_a_part_of_that_edit(nearer: Session, editor: Editor) -> None:
    scene = editor.scene
    editor.show_object("object 2")
    finish(nearer)
    assert editor.scene.camera == replace(scene.camera, distance=1.1)
    assert len(editor.history.past) == 1
    editor.undo()
    assert editor.scene == scene
    editor.redo()
    finish(nearer)
    assert editor.scene.camera.distance == 1.1


@pytest.mark.parametrize("view", orbit.VIEWS)
def test_a_standard_view_shows_the_whole_object(nearer: Session, editor: Editor, view: str) -> None:
    editor.set_camera(orbit.zoomed(editor.scene.camera, 9.0, editor.model), gesture="zoom")
    editor.end_gesture()
    nearer.see_from(view)
    finish(nearer)
    assert editor.scene.camera.distance == 1.1
    assert len(editor.history.past) == 2


def test_a_hand_that_turns_the_object_is_never_disturbed(nearer: Session, editor: Editor) -> None:
    editor.show_object("object 2")
    turned = orbit.turned(editor.scene.camera, 0.3, 0.0)
    editor.set_camera(turned, gesture="orbit")
    finish(nearer)
    assert editor.scene.camera == turned
    editor.end_gesture()
    editor.show_object("object 3")
    finish(nearer)
    assert editor.scene.camera == replace(turned, distance=1.1)


def test_the_first_view_of_a_fitted_object_is_its_photos(nearer: Session, editor: Editor) -> None:
    fitted_object = fitted(editor.model)
    assert fitted_object.instance.detail is not None
    editor.add_and_show(fitted_object, orbit.home(editor.model))
    nearer.viewport.reset_view()
    finish(nearer)
    photo_camera = orbit.photo_camera(fitted_object.instance.detail.views[0].camera, editor.model)
    assert editor.scene.camera == replace(photo_camera, distance=1.1)


def test_a_view_sized_while_a_fit_begins_is_not_turned_by_a_person(nearer: Session, editor: Editor) -> None:
    nearer.viewport.follow()  # as with --image, before the window is there
    nearer.viewport.change(panel=(600, 400))
    finish(nearer)
    assert not nearer.viewport.turned


def test_a_stretched_object_moves_away_once_it_is_too_large(session: Session, editor: Editor) -> None:
    session.jobs.backend = replace(session.jobs.backend, distance=lambda *inputs: 1.5)
    camera = editor.scene.camera
    assert camera.distance < 1.4
    editor.edit(editor.scene.instance.with_edits(Stretch, Stretch((1.0, 1.0, 1.5))), gesture="size box")
    finish(session)
    held = editor.scene.camera.distance
    assert held < 1.4  # the side stays under the mouse that drags it
    editor.end_gesture()
    finish(session)
    assert editor.scene.camera.distance == 1.5
    editor.undo()
    finish(session)
    assert editor.scene.camera == camera
    session.jobs.backend = replace(session.jobs.backend, distance=lambda *inputs: 0.9)
    editor.edit(editor.scene.instance.with_edits(Stretch, Stretch((1.0, 1.0, 0.9))))
    finish(session)
    assert editor.scene.camera.distance > 1.0  # an object that fits stays where it is


def test_a_zoom_of_a_persons_own_stays_until_home(nearer: Session, editor: Editor, session: Session) -> None:
    zoomed = orbit.zoomed(editor.scene.camera, 3, session.editor.model)
    editor.set_camera(zoomed, gesture="zoom")
    editor.end_gesture()
    editor.show_object("object 2")
    finish(nearer)
    assert editor.scene.camera == zoomed
    session.viewport.reset_view()
    finish(nearer)
    assert editor.scene.camera == replace(orbit.home(session.editor.model), distance=1.1)
    editor.show_object("object 3")
    finish(nearer)
    assert editor.scene.camera.distance == 1.1
