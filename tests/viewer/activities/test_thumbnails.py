from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from core.detail.progressive import Frame, RenderJob
from core.models.model import Model
from tests.viewer.driver import deliver, finish
from tests.viewer.stand_ins import quick_frames
from viewer.activities.thumbnails import Thumbnails
from viewer.session import Session


def test_a_thumbnail_is_rendered_once_for_equal_codes(session: Session, model: Model) -> None:
    rendered: list[RenderJob] = []

    def counted(job: RenderJob) -> Iterator[Frame | None]:
        rendered.append(job)
        return quick_frames(job)

    session.jobs.backend = replace(session.jobs.backend, frames=counted)
    camera = model.camera(0.1, 0.2).resized(16, 16)
    assert session.thumbnails.get(model[1], camera) is None
    finish(session)
    thumbnail = session.thumbnails.get(model[1].mixed(model[2], 0.0, 0.0), camera)
    assert thumbnail.resolution == (16, 16)
    assert session.thumbnails.get(model[2], camera) is None
    finish(session)
    assert len(rendered) == 2


def test_a_request_that_is_not_repeated_is_dropped(session: Session, model: Model) -> None:
    camera = model.camera(0.1, 0.2).resized(16, 16)
    for index in range(40):
        session.thumbnails.get(model[index % 6].mixed(model[0], index / 40, 0.0), camera)
    finish(session)
    before = len(session.thumbnails.newest()())
    assert 0 < before < 40
    finish(session)
    assert len(session.thumbnails.newest()()) == before


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


def test_a_repeated_request_is_rendered_once(session: Session, model: Model) -> None:
    widths: list[int] = []

    def counted(job: RenderJob) -> Iterator[Frame | None]:
        widths.append(job.camera.width)
        return quick_frames(job)

    session.jobs.backend = replace(session.jobs.backend, frames=counted)
    camera = model.camera(0.1, 0.2).resized(64, 64)
    deliver(session, lambda: None not in [session.thumbnails.get(model[index], camera) for index in range(3)])
    assert widths == [64, 64, 64]


def test_stored_thumbnails_are_shown_at_the_next_launch(session: Session, model: Model) -> None:
    def shown(thumbnails: Thumbnails) -> list[Frame | None]:
        return [thumbnails.of_object(model[index]) for index in range(3)]

    first = Thumbnails(session.jobs)
    while None in (before := shown(first)):
        first.tick()
        finish(session)
    again = Thumbnails(session.jobs, first.newest()())
    for kept, restored in zip(before, shown(again), strict=True):
        assert kept and restored
        np.testing.assert_array_equal(kept.image, restored.image)
        np.testing.assert_allclose(kept.opacity, restored.opacity, atol=1 / 255)
