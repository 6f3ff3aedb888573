from dataclasses import replace
from pathlib import Path

import pytest

from tests.viewer.driver import deliver, finish
from tests.viewer.stand_ins import endless_fit
from viewer.editor import Editor
from viewer.session import Session
from viewer.values import orbit


@pytest.fixture
def growing(session: Session, photo: Path) -> Session:
    """A fit under way that the view shows."""
    session.jobs.backend = replace(session.jobs.backend, fit=endless_fit)
    session.fitting.start(photo)
    deliver(session, lambda: session.viewport.source == "fit")
    return session


def test_the_view_is_turned_around_the_growing_object(session: Session, editor: Editor, growing: Session) -> None:
    fitting, viewport = growing.fitting, growing.viewport
    seen_from = viewport.camera
    assert seen_from.azimuth == pytest.approx(1.0)
    turned = orbit.turned(seen_from, 0.8, 0.0)
    editor.set_camera(turned, "orbit")
    editor.end_gesture()
    assert viewport.following
    assert viewport.turned
    assert viewport.camera == turned
    assert viewport.source == "fit"
    shown = viewport.frame
    deliver(session, lambda: viewport.frame is not shown)
    assert viewport.full_frame[1].camera.azimuth == turned.azimuth
    shown, steps = viewport.frame, len(fitting.history.steps)
    deliver(session, lambda: viewport.frame is not shown and len(fitting.history.steps) > steps)
    assert viewport.full_frame[1].camera.azimuth == turned.azimuth
    fitting.stop()
    finish(session)
    assert editor.state.mix.a.shape == "block"
    assert editor.scene.camera == turned


def test_follow_returns_to_the_camera_of_the_photo(session: Session, editor: Editor, growing: Session) -> None:
    fitting, viewport = growing.fitting, growing.viewport
    editor.set_camera(orbit.turned(viewport.camera, 0.8, 0.0))
    assert viewport.turned
    fitting.follow()
    assert not viewport.turned
    deliver(session, lambda: viewport.full_frame[1].camera.azimuth == pytest.approx(1.0))
    fitting.stop()
    finish(session)
    assert editor.scene.camera == fitting.view.camera


def test_follow_returns_to_the_fit_after_an_edit(session: Session, editor: Editor, growing: Session) -> None:
    fitting, viewport = growing.fitting, growing.viewport
    editor.show_object("object 5")
    assert not viewport.following
    assert viewport.source == "scene"
    fitting.follow()
    assert viewport.following
    deliver(session, lambda: viewport.source == "fit")
    fitting.stop()
    assert editor.state.mix.a.shape == "block"
    assert not fitting.results.unseen
