"""Parts of finished images, and drags whose edits the worker makes."""

import threading
from collections.abc import Callable
from dataclasses import replace

import pytest

from core.detail.progressive import Frame
from core.directions.part_map import Box, Handle, PartMap
from core.geometry.camera import Camera
from core.models.model import Instance
from core.models.motion import LIMIT
from tests.viewer.driver import deliver, finish
from tests.viewer.stand_ins import two_parts
from viewer.editor import Editor
from viewer.session import Session
from viewer.values import orbit
from viewer.values.direction import Direction

_TOP = Handle("back", (0.5, 0.4), (0.0, 0.0, 0.3))
_WORDS = ("wider", "", "taller")


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
        across, down = visible.place_of(handle)
        width = visible.crop.camera.width / visible.crop.width  # of the image, relative to the view
        assert across == pytest.approx(0.5 + 0.25 * 512 / 640 + (handle.place[0] - 0.5) * width, abs=0.02)
        assert down == pytest.approx(handle.place[1], abs=0.02)
        assert visible.handle_at((across, down)) is handle
    assert visible.handle_at((0.05, 0.5)) is None


def test_nothing_has_parts_while_a_fit_is_followed(session: Session, searched: list[Camera]) -> None:
    session.viewport.follow()
    finish(session)
    assert session.reshaping.parts is None
    session.viewport.unfollow()
    assert session.reshaping.parts is None
    finish(session)
    assert session.reshaping.parts is not None


def test_a_drag_of_a_handle_is_one_step(session: Session, editor: Editor) -> None:
    reshaping = session.reshaping
    direction = Direction.principal(editor.model.codes, "shape", 2)
    past = len(editor.history.past)
    start = editor.strength(direction)
    low, high = direction.reach(editor.scene.instance)
    assert reshaping.drag is None
    reshaping.drag_handle(_TOP, (0.0, -0.001), _WORDS)  # too short to know where it goes
    assert reshaping.drag is None
    for up in (0.02, 0.05):
        reshaping.drag_handle(_TOP, (0.0, -up), _WORDS)
        finish(session)
    assert start < editor.strength(direction) < high
    assert reshaping.drag is not None and reshaping.drag.direction.index == 2
    reshaping.drag_handle(_TOP, (0.0, -9.0), _WORDS)
    reshaping.release()  # before the worker has made the last edit
    reshaping.drag_handle(_TOP, (0.0, 9.0), _WORDS)  # too early
    finish(session)
    assert editor.strength(direction) == pytest.approx(high, abs=1e-3)  # no further than a slider
    assert high - low <= 2 * LIMIT + 1e-3
    assert len(editor.history.past) == past + 1
    assert not editor.history.gesture
    editor.undo()
    assert editor.strength(direction) == pytest.approx(start)


def test_of_several_positions_the_worker_takes_the_newest(
    session: Session, editor: Editor, monkeypatch: pytest.MonkeyPatch
) -> None:
    may_go_on = threading.Event()
    positions = list[float]()
    moved: Callable[[Direction, Instance, float], Instance] = Direction.moved

    def slowly(direction: Direction, instance: Instance, to: float) -> Instance:
        positions.append(to)
        may_go_on.wait(60)
        return moved(direction, instance, to)

    monkeypatch.setattr(Direction, "moved", slowly)
    direction = Direction.principal(editor.model.codes, "texture", 0)
    session.reshaping.move_along(direction, 0.1, "slider")
    deliver(session, lambda: len(positions) == 1)
    for to in (0.2, 0.3, 0.4, 0.4):
        session.reshaping.move_along(direction, to, "slider")
    may_go_on.set()
    finish(session)
    session.reshaping.release()
    assert positions == [0.1, 0.4]
    assert editor.strength(direction) == pytest.approx(0.4, abs=1e-3)


def test_an_edit_that_comes_after_an_undo_changes_nothing(session: Session, editor: Editor) -> None:
    editor.sample()
    session.reshaping.move_along(Direction.principal(editor.model.codes, "shape", 0), 0.3, "slider")
    editor.undo()
    before = editor.scene
    session.reshaping.release()
    finish(session)
    assert editor.scene is before


def test_a_held_handle_leaves_another_shape_alone(session: Session, editor: Editor) -> None:
    for interrupt in (editor.undo, lambda: editor.show_object(editor.state.mix.b)):
        for up in (0.02, 0.05):
            session.reshaping.drag_handle(_TOP, (0.0, -up), _WORDS)
            finish(session)
        interrupt()
        before = editor.scene
        session.reshaping.drag_handle(_TOP, (0.0, -0.09), _WORDS)
        session.reshaping.release()
        finish(session)
        assert editor.scene is before


def test_a_paint_that_comes_during_a_drag_does_not_end_it(session: Session, editor: Editor) -> None:
    session.reshaping.drag_handle(_TOP, (0.0, -0.02), _WORDS)
    finish(session)
    texture = editor.model[2].codes.texture
    editor.set_texture(texture)
    shape = editor.code("shape")
    session.reshaping.drag_handle(_TOP, (0.0, -0.05), _WORDS)
    session.reshaping.release()
    finish(session)
    assert editor.code("shape") is not shape and editor.code("texture") is texture
