from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from core.detail.progressive import Frame, RenderJob
from core.models.model import Model
from tests.viewer.driver import deliver, finish
from tests.viewer.stand_ins import quick_frames
from viewer.activities.thumbnails import Thumbnails
from viewer.session import Session


def test_repeated_requests_for_equal_codes_are_rendered_once(session: Session, model: Model) -> None:
    rendered: list[RenderJob] = []

    def counted(job: RenderJob) -> Iterator[Frame | None]:
        rendered.append(job)
        return quick_frames(job)

    session.jobs.backend = replace(session.jobs.backend, frames=counted)
    camera = model.camera(0.1, 0.2).resized(16, 16)
    instances = model[1], model[1].mixed(model[2], 0.0, 0.0), model[2]
    assert session.thumbnails.get(model[1], camera) is None
    deliver(session, lambda: None not in [session.thumbnails.get(instance, camera) for instance in instances])
    assert session.thumbnails.get(model[1], camera).resolution == (16, 16)
    assert len(rendered) == 2


def test_a_request_that_is_not_repeated_is_dropped(session: Session, model: Model) -> None:
    camera = model.camera(0.1, 0.2).resized(16, 16)
    for index in range(40):
        session.thumbnails.get(model[index % 6].mixed(model[0], index / 40, 0.0), camera)
    finish(session)
    count = len(session.thumbnails.newest()())
    assert 0 < count < 40
    finish(session)
    assert len(session.thumbnails.newest()()) == count


def test_thumbnails_that_cannot_be_rendered_are_reported_once(session: Session, model: Model) -> None:
    def broken(job: RenderJob) -> Iterator[Frame | None]:
        raise ValueError("no image today")

    session.jobs.backend = replace(session.jobs.backend, frames=broken)
    session.thumbnails.get(model[1], model.camera(0.1, 0.2).resized(16, 16))
    finish(session)
    assert session.messages.errors == ["Cannot render the thumbnails: no image today"]
    session.messages.all.clear()
    session.thumbnails.get(model[1], model.camera(0.1, 0.2).resized(16, 16))
    finish(session)
    assert session.messages.errors == []


def test_another_model_has_other_thumbnails(session: Session, model: Model) -> None:
    session.thumbnails.get(model[1], model.camera(0.1, 0.2).resized(16, 16))
    finish(session)
    assert len(session.thumbnails.newest()()) == 1
    session.new()
    finish(session)
    assert not session.thumbnails.newest()()


def test_stored_thumbnails_are_shown_at_the_next_launch(session: Session, model: Model) -> None:
    def shown(thumbnails: Thumbnails) -> list[Frame | None]:
        return [thumbnails.of_object(model[index]) for index in range(3)]

    first = Thumbnails(session.jobs)
    while None in (frames := shown(first)):
        first.tick()
        finish(session)
    again = Thumbnails(session.jobs, first.newest()())
    for stored, restored in zip(frames, shown(again), strict=True):
        assert stored and restored
        np.testing.assert_array_equal(stored.image, restored.image)
        np.testing.assert_allclose(stored.opacity, restored.opacity, atol=1 / 255)
