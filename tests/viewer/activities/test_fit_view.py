import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from core.fitting.fit import FitJob, FitStep
from core.models.model import Model
from core.rendering.progressive import Frame, RenderJob
from tests.viewer.driver import deliver, finish
from tests.viewer.stand_ins import endless_fit, quick_fit
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
    assert not fitting.can_follow
    editor.set_camera(orbit.turned(viewport.camera, 0.8, 0.0))
    assert fitting.can_follow
    fitting.follow()
    assert not fitting.can_follow
    deliver(session, lambda: viewport.full_frame[1].camera.azimuth == pytest.approx(1.0))
    fitting.stop()
    finish(session)
    assert editor.scene.camera == fitting.view.camera


def test_follow_returns_to_the_fit_after_an_edit(session: Session, editor: Editor, growing: Session) -> None:
    fitting, viewport = growing.fitting, growing.viewport
    editor.show_object("object 5")
    assert not viewport.following
    assert viewport.source == "scene"
    assert fitting.can_follow
    fitting.follow()
    assert viewport.following
    deliver(session, lambda: viewport.source == "fit")
    fitting.stop()
    assert editor.state.mix.a.shape == "block"
    assert not fitting.results.unseen


def paint_middle(model: Model, job: RenderJob) -> Iterator[Frame | None]:
    """Black in the middle, where the camera looks, white elsewhere."""
    height, width = job.camera.height, job.camera.width
    image = np.full((height, width, 3), 255, np.uint8)
    image[height // 2, width // 2] = 0
    yield Frame(image, np.zeros((height, width), np.float32), np.ones((height, width), np.float32), 0, 1, 8, 0.0)


def test_the_render_lies_where_the_photo_has_the_object(session: Session, photo: Path) -> None:
    model = session.editor.model
    shift = torch.tensor([[0.0, 0.0, 5.0, -3.0]]) / model.focal

    def moved_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
        for step in quick_fit(model, job):
            first, *others = step.hypotheses
            yield replace(step, hypotheses=(replace(first, crop_transform=shift), *others))

    session.jobs.backend = replace(session.jobs.backend, fit=moved_fit, frames=paint_middle)
    session.fitting.start(photo)
    finish(session)
    frame = session.fitting.history.frame
    assert frame is not None
    middle = model.image_size // 2
    assert np.argwhere(frame.image[..., 0] == 0).tolist() == [[middle - 3, middle + 5]]


def test_the_render_is_turned_as_the_photo_is(session: Session, photo: Path) -> None:
    """Clockwise, around where the photo has the object."""
    model = session.editor.model

    def paint_right(model: Model, job: RenderJob) -> Iterator[Frame | None]:
        height, width = job.camera.height, job.camera.width
        image, opaque = np.full((height, width, 3), 255, np.uint8), np.ones((height, width), np.float32)
        image[height // 2 - 2 : height // 2 + 2, width // 2 + 5 : width // 2 + 9] = 0
        yield Frame(image, opaque, opaque, 0, 1, 8, 0.0)

    def rolled_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
        transform = torch.tensor([[0.0, math.pi / 2, 2 / model.focal, -3 / model.focal]])
        for step in quick_fit(model, job):
            first, *others = step.hypotheses
            yield replace(step, hypotheses=(replace(first, crop_transform=transform), *others))

    session.jobs.backend = replace(session.jobs.backend, fit=rolled_fit, frames=paint_right)
    session.fitting.start(photo)
    finish(session)
    frame = session.fitting.history.frame
    assert frame is not None
    black, middle = np.argwhere(frame.image[..., 0] == 0), model.image_size // 2
    assert black.min(0).tolist() == [middle - 3 + 5, middle + 2 - 2]
    assert black.max(0).tolist() == [middle - 3 + 8, middle + 2 + 1]
