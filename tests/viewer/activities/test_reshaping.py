"""Parts of finished images, and drags whose edits the worker makes."""

from dataclasses import replace

import pytest

from core.detail.progressive import Frame
from core.editing.bounds import Bounds
from core.editing.parts import Box, Handle, PartMap
from core.editing.size import lengths
from core.geometry.camera import Camera
from core.models.model import Instance
from tests.viewer.driver import finish
from tests.viewer.stand_ins import two_parts
from viewer.editor import Editor
from viewer.session import Session
from viewer.values import orbit
from viewer.values.direction import Direction

_TOP = Handle("back", (0.5, 0.4), (0.0, 0.0, 0.3))


@pytest.fixture
def searched(session: Session) -> list[Camera]:
    """Cameras of the images in which parts were looked for."""
    cameras = list[Camera]()

    def find(instance: Instance, camera: Camera, frame: Frame, box: Box) -> PartMap:
        cameras.append(camera)
        return two_parts(instance, camera, frame, box)

    session.jobs.backend = replace(session.jobs.backend, part_map=find)
    session.viewport.change(panel=(640, 512))
    finish(session)
    return cameras


def test_the_parts_of_a_finished_image_are_found_once(session: Session, editor: Editor, searched: list[Camera]) -> None:
    reshaping = session.reshaping
    assert searched == []  # nobody has asked
    assert reshaping.parts is None
    finish(session)
    visible = reshaping.parts
    assert visible is not None and visible is reshaping.parts
    assert set(visible.highlights) == {"seat", "back"}
    finish(session)
    assert len(searched) == 1
    editor.set_camera(orbit.turned(editor.scene.camera, 0.3, 0.0), gesture="orbit")
    for _ in range(3):
        session.tick()
        assert reshaping.parts is None
    finish(session)
    assert reshaping.parts is None and len(searched) == 1  # the drag goes on
    editor.end_gesture()
    assert reshaping.parts is None
    finish(session)
    assert reshaping.parts is not None and len(searched) == 2


def test_a_place_of_the_view_is_one_of_the_image(session: Session, searched: list[Camera]) -> None:
    session.viewport.pan_by(0.25, 0.0)
    finish(session)
    assert session.reshaping.parts is None
    finish(session)
    visible = session.reshaping.parts
    assert visible is not None
    for handle in visible.map.handles:
        right, down = visible.place_of(handle)
        width = visible.crop.camera.width / visible.crop.width  # of the image, relative to the view
        assert right == pytest.approx(0.5 + 0.25 * 512 / 640 + (handle.place[0] - 0.5) * width, abs=0.02)
        assert down == pytest.approx(handle.place[1], abs=0.02)
        assert visible.handle_at((right, down)) is handle
    assert visible.handle_at((0.05, 0.5)) is None


def test_nothing_has_parts_while_a_fit_is_followed(session: Session, searched: list[Camera]) -> None:
    session.viewport.follow()
    finish(session)
    assert session.reshaping.parts is None
    session.viewport.unfollow()
    assert session.reshaping.parts is None
    finish(session)
    assert session.reshaping.parts is not None


@pytest.fixture
def measured(session: Session) -> Bounds:
    """The natural bounds of the object on screen."""
    assert session.reshaping.bounds is None
    finish(session)
    assert session.reshaping.bounds is not None
    return session.reshaping.bounds


def test_a_drag_of_a_handle_is_one_step(session: Session, editor: Editor, measured: Bounds) -> None:
    reshaping = session.reshaping
    instance = editor.scene.instance
    past = len(editor.history.past)

    def height() -> float:
        return lengths(editor.scene.instance, measured)["height"]

    start = height()
    reshaping.drag_handle(_TOP, (0.0, -0.001))  # too short to know where it goes
    assert reshaping.pull is None
    for up in (0.02, 0.05):
        reshaping.drag_handle(_TOP, (0.0, -up))
    assert reshaping.pull is not None and reshaping.pull.name == "height"
    assert 1.02 * start < height() < 2 * start and not reshaping.is_past_end
    reshaping.drag_handle(_TOP, (0.0, -99.0))
    assert reshaping.is_past_end
    reshaping.release()
    assert reshaping.pull is None and not reshaping.is_past_end
    assert height() == pytest.approx(10 * start)  # no further than in the fields
    assert len(editor.history.past) == past + 1
    assert not editor.history.gesture
    editor.undo()
    assert editor.scene.instance == instance


def test_a_drag_back_to_its_start_leaves_no_edit(session: Session, editor: Editor) -> None:
    instance = editor.scene.instance
    direction = Direction.principal(editor.model.codes, "shape", 0)
    start = direction.strength(editor.scene.instance)
    for by in (0.1, 0.7, -0.3, 0.0):
        session.reshaping.follow("slider", direction.moved, start + by)
    session.reshaping.release()
    assert editor.scene.instance == instance


def test_lengths_are_resized_from_the_start_of_the_drag(session: Session, editor: Editor, measured: Bounds) -> None:
    usual_lengths = lengths(editor.scene.instance, measured)
    for factor in (1.3, 1e9, 1.1):  # on the way beyond the limit
        session.reshaping.resize("width", factor * usual_lengths["width"])
    session.reshaping.release()
    resized_lengths = lengths(editor.scene.instance, measured)
    assert resized_lengths == pytest.approx(usual_lengths | {"width": 1.1 * usual_lengths["width"]})
    session.reshaping.resize("width", usual_lengths["width"])
    session.reshaping.release()
    assert not editor.scene.instance.is_sized and len(editor.history.past) == 2


def test_a_held_handle_leaves_another_shape_alone(session: Session, editor: Editor, measured: Bounds) -> None:
    for interrupt in (editor.undo, lambda: editor.show_object(editor.state.mix.b)):
        for up in (0.02, 0.05):
            session.reshaping.drag_handle(_TOP, (0.0, -up))
            finish(session)
        interrupt()
        scene = editor.scene
        session.reshaping.drag_handle(_TOP, (0.0, -0.09))
        session.reshaping.release()
        finish(session)
        assert editor.scene is scene


def test_a_paint_that_comes_during_a_drag_does_not_end_it(session: Session, editor: Editor, measured: Bounds) -> None:
    session.reshaping.drag_handle(_TOP, (0.0, -0.02))
    finish(session)
    texture = editor.model[2].codes.texture
    editor.edit(editor.scene.instance.changed(texture=texture))
    edits = editor.scene.instance.codes.edits
    session.reshaping.drag_handle(_TOP, (0.0, -0.05))
    session.reshaping.release()
    assert editor.scene.instance.codes.edits != edits and editor.scene.instance.codes.texture is texture
