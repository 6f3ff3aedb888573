from dataclasses import replace
from pathlib import Path

import pytest

from tests.viewer.driver import finish
from tests.viewer.stand_ins import Bakery, Clock
from viewer.activities.idle_turn import IdleTurn
from viewer.editor import Editor
from viewer.session import Session
from viewer.values import orbit


@pytest.fixture
def idle(session: Session, photo: Path, clock: Clock) -> IdleTurn:
    """A result has just come into the view."""
    session.jobs.backend = replace(session.jobs.backend, bake=Bakery())
    viewport = session.viewport
    viewport.change(opengl=True)
    turn = IdleTurn(session.jobs, session.editor, viewport, clock)
    session.fitting.start(photo)
    finish(session, lambda: viewport.sharp and viewport.is_baked(session.editor.scene.instance))
    return turn


def test_a_result_turns_until_it_is_stopped_there(idle: IdleTurn, clock: Clock, session: Session, editor: Editor):
    before, edits = editor.scene, len(editor.history.past)
    idle.tick()
    assert not idle.turning  # the finished picture first
    azimuths = []
    for clock.now in (3.0, 4.0):
        idle.tick()
        azimuths.append(session.viewport.baked_frame.camera.azimuth)
    assert before.camera.azimuth != azimuths[0] != azimuths[1]
    assert editor.scene is before  # no edit
    idle.stop()
    assert not idle.due
    assert editor.scene.camera == replace(before.camera, azimuth=azimuths[1])
    assert len(editor.history.past) == edits


def test_it_stays_where_it_is_though_an_exact_picture_comes_between_two_frames(
    idle: IdleTurn, clock: Clock, session: Session, editor: Editor
) -> None:
    """Of slow frames: the view takes their length for a rest."""
    before, viewport = editor.scene.camera, session.viewport
    for clock.now in (0.0, 3.0):
        idle.tick()
    assert viewport.baked_frame is not None and viewport.full_frame is not None
    azimuth = viewport.baked_frame.camera.azimuth
    viewport.baked_frame = None
    idle.stop()
    assert editor.scene.camera.azimuth == azimuth != before.azimuth


def test_an_edit_ends_it(idle: IdleTurn, clock: Clock, editor: Editor) -> None:
    idle.tick()
    turned = orbit.turned(editor.scene.camera, 0.1, 0.0)
    editor.set_camera(turned)
    clock.now = 3.0
    idle.tick()
    assert not idle.due
    assert editor.scene.camera == turned


def test_what_is_not_baked_does_not_turn(idle: IdleTurn, clock: Clock, session: Session) -> None:
    session.viewport.change(opengl=False)
    for clock.now in (0.0, 3.0):
        idle.tick()
    assert not idle.turning
