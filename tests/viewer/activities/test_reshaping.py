from dataclasses import replace

import pytest

from core.directions.grab import Pull
from core.geometry.camera import Camera
from core.models.model import Instance
from core.models.motion import LIMIT
from tests.viewer.driver import finish
from viewer.editor import Editor
from viewer.session import Session
from viewer.values.direction import Direction

_PULL = Pull(2, 0.3, (0.0, -20.0))  # a standard deviation moves the surface up by 20 of 256 px


@pytest.fixture
def places(session: Session) -> list[tuple[Camera, tuple[float, float]]]:
    """Cameras and points at which pulls were looked for; there is one in the middle only."""
    asked = list[tuple[Camera, tuple[float, float]]]()

    def pulls(instance: Instance, camera: Camera, point: tuple[float, float]) -> list[Pull]:
        asked.append((camera, point))
        return [_PULL] if abs(point[0] - camera.width / 2) < 20 else []

    session.jobs.backend = replace(session.jobs.backend, pulls=pulls)
    session.viewport.change(panel=(512, 512))
    return asked


def test_a_pull_is_one_step(session: Session, editor: Editor, places: list[tuple[Camera, tuple[float, float]]]) -> None:
    grabbing, direction = session.grabbing, Direction.principal(editor.model.codes, "shape", 2)
    grabbing.look((0.5, 0.5))
    finish(session)
    assert grabbing.pull == _PULL
    start, past = editor.strength(direction), len(editor.history.past)
    for up in (10, 20, 40):
        grabbing.drag((0.0, -float(up)))  # px of a view of 512: half of them are those of the pull
    assert editor.strength(direction) == pytest.approx(start + 1.0, abs=1e-3)
    grabbing.drag((0.0, -9999.0))
    assert editor.strength(direction) == pytest.approx(start + LIMIT, abs=1e-3)  # no further than a slider
    grabbing.release()
    assert len(editor.history.past) == past + 1
    editor.undo()
    assert editor.strength(direction) == pytest.approx(start)


def test_nothing_is_pulled_beside_the_object(
    session: Session, editor: Editor, places: list[tuple[Camera, tuple[float, float]]]
) -> None:
    before = editor.state
    session.grabbing.look((0.1, 0.5))
    finish(session)
    session.grabbing.drag((0.0, 50.0))
    session.grabbing.release()
    assert session.grabbing.pull is None
    assert editor.state is before


def test_a_place_is_a_point_of_what_the_camera_sees(session: Session, places: list[tuple[Camera, tuple[float, float]]]):
    session.viewport.pan_by(0.25, 0.0)
    session.grabbing.look((0.75, 0.5))  # where the object is now
    session.grabbing.look((0.75, 0.5))
    finish(session)
    ((camera, point),) = places
    assert point == pytest.approx((camera.width / 2, camera.height / 2), abs=1.0)
    assert session.grabbing.pull == _PULL
