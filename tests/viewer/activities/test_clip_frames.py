"""A video becomes the photos of a fit; what reads it is a stand-in."""

from collections.abc import Generator
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from core.photos.clip_object import ClipCuts, FrameCut
from core.photos.segmentation import cut_out
from tests.viewer.driver import deliver, finish, fit
from tests.viewer.stand_ins import endless_fit
from viewer.services.messages import MessageKind
from viewer.session import Session
from viewer.store.photo_copies import PhotoCopies
from viewer.values.fit_history import PhotoSource


def frame(number: int) -> FrameCut:
    """A frame with a red block, further right in later ones."""
    image = Image.new("RGBA", (96, 96), "white")
    image.paste((200, 30, 30, 255), (20 + number, 20, 50 + number, 80))
    return FrameCut(f"block.mp4 at {number}.0 s", image, cut_out(image))


def six_frames(path: Path) -> Generator[float, None, ClipCuts]:
    yield 0.5
    yield 1.0
    return ClipCuts(tuple(map(frame, range(6))), "2 of 8 frames are left out: no object at 7.0 s")


def endless_clip(path: Path) -> Generator[float, None, ClipCuts]:
    while True:
        yield 0.25


def broken_clip(path: Path) -> Generator[float, None, ClipCuts]:
    yield 0.0
    raise ValueError(f"{path}: there is sound, but no video")


@pytest.fixture
def video(session: Session) -> Path:
    session.jobs.backend = replace(session.jobs.backend, clip=six_frames)
    return Path("block.mp4")


def test_spread_frames_of_a_video_are_fitted_as_photos_of_one_object(session: Session, video: Path) -> None:
    fit(session, video)
    history = session.fitting.history
    assert session.editor.objects.own[0] == "block, 4 photos"
    lefts = [int(fitted.preview.pixels.min((0, 2)).argmin()) for fitted in history.photos if fitted.preview]
    assert [left - lefts[0] for left in lefts] == [0, 2, 3, 5]
    assert [source.path for source in history.sources] == [video] * 4
    assert len(set(history.sources)) == 4
    notes = [message.text for message in session.messages.log if message.kind is MessageKind.NOTE]
    assert "block.mp4: 2 of 8 frames are left out: no object at 7.0 s" in notes


def test_a_fit_of_a_video_is_repeated_without_reading_it_again(session: Session, video: Path) -> None:
    fit(session, video)
    session.jobs.backend = replace(session.jobs.backend, clip=broken_clip)
    session.fitting.refit()
    finish(session, lambda: not session.fitting.running)
    assert session.messages.errors == []
    assert len(session.fitting.history.photos) == 4


def test_an_interrupted_fit_of_a_video_goes_on_with_its_frames(session: Session, video: Path) -> None:
    session.jobs.backend = replace(session.jobs.backend, fit=endless_fit)
    session.fitting.start(video)
    deliver(session, lambda: bool(session.fitting.history.steps))
    (request,) = session.fitting.pending
    assert len(request.history.sources) == len(request.history.photos) == 4
    session.fitting.close()
    finish(session)


def test_reading_a_video_is_stopped(session: Session, video: Path) -> None:
    session.jobs.backend = replace(session.jobs.backend, clip=endless_clip)
    objects = session.editor.objects.own
    session.fitting.start(video)
    deliver(session, lambda: session.fitting.view.read_fraction == 0.25)
    session.fitting.stop()
    finish(session)
    assert not session.fitting.running
    assert session.editor.objects.own == objects


def test_a_video_that_cannot_be_read_is_reported_and_can_be_tried_again(session: Session, video: Path) -> None:
    session.jobs.backend = replace(session.jobs.backend, clip=broken_clip)
    fit(session, video)
    assert session.messages.errors == ["Cannot fit this image: block.mp4: there is sound, but no video"]
    (question,) = session.fitting.questions
    session.jobs.backend = replace(session.jobs.backend, clip=six_frames)
    session.answers.try_again(question.request)
    finish(session, lambda: not session.fitting.running)
    assert session.editor.objects.own[0] == "block, 4 photos"


def test_a_video_waits_for_the_photo_before_it(session: Session, video: Path, photo: Path) -> None:
    session.fitting.start(photo, video)
    assert len(session.fitting.waiting.requests) == 1
    finish(session, lambda: not session.fitting.running)
    assert session.editor.objects.own == ["block", "block, 4 photos"]


def test_a_copy_of_a_frame_is_read_in_place_of_the_video(tmp_path: Path) -> None:
    copies = PhotoCopies()
    source = PhotoSource(tmp_path / "walk.mp4")
    images = [Image.new("RGBA", (8, 8), colour) for colour in ("red", "blue")]
    photos = [copies.keep(source, image) for image in images]
    assert [Image.open(photo.file).getpixel((0, 0)) for photo in photos] == [(255, 0, 0, 255), (0, 0, 255, 255)]
    assert [photo.file.name for photo in photos] == ["walk.png"] * 2
