from collections.abc import Iterator
from dataclasses import replace

from core.models.model import Model
from core.rendering.progressive import Frame, RenderJob
from tests.viewer.window_driver import finish, quick_frames
from viewer.session import Session


def test_a_picture_is_drawn_once_for_equal_codes(session: Session, model: Model) -> None:
    asked: list[RenderJob] = []

    def counted(model: Model, job: RenderJob) -> Iterator[Frame | None]:
        asked.append(job)
        return quick_frames(model, job)

    session.streams = replace(session.streams, frames=counted)
    camera = model.camera(0.1, 0.2).resized(16, 16)
    assert session.stills.picture(model.codes[1], camera) is None
    finish(session)
    found = session.stills.picture(model.codes[1].mixed(model.codes[2], 0.0, 0.0), camera)
    assert found is not None
    assert found.resolution == (16, 16)
    assert session.stills.picture(model.codes[2], camera) is None
    finish(session)
    assert len(asked) == 2


def test_what_is_asked_for_no_more_is_not_drawn(session: Session, model: Model) -> None:
    camera = model.camera(0.1, 0.2).resized(16, 16)
    for index in range(40):
        session.stills.picture(model.codes[index % 6].mixed(model.codes[0], index / 40, 0.0), camera)
    finish(session)
    before = session.stills.drawn
    assert 0 < before < 40
    finish(session)
    assert session.stills.drawn == before


def test_pictures_that_cannot_be_drawn_are_told(session: Session, model: Model) -> None:
    def broken(model: Model, job: RenderJob) -> Iterator[Frame | None]:
        raise ValueError("no picture today")

    session.streams = replace(session.streams, frames=broken)
    session.stills.picture(model.codes[1], model.camera(0.1, 0.2).resized(16, 16))
    finish(session)
    assert session.errors == ["Cannot draw the small pictures: no picture today"]


def test_another_model_has_other_pictures(session: Session, model: Model) -> None:
    session.stills.picture(model.codes[1], model.camera(0.1, 0.2).resized(16, 16))
    finish(session)
    session.open_model("chairs")
    finish(session)
    assert session.stills.drawn == 0
