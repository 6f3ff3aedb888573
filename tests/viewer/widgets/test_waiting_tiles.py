import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from core.fitting.fit import FitJob, FitStep
from core.models.model import Model
from core.photos.photo import Photo, read_cut_out
from core.photos.segmentation import CutOut, Hints
from tests.viewer.driver import Drive, Driver, in_window
from tests.viewer.stand_ins import doubted, quick_fit, quick_photo
from tests.viewer.test_editor import fitted
from viewer.services.backend import Backend
from viewer.values.fit_history import PhotoSource


class LearningFit:
    """Differentiates in every step, as a real fit does; goes on until it is told to end."""

    def __init__(self) -> None:
        self.may_end = threading.Event()

    def __call__(self, model: Model, job: FitJob) -> Iterator[FitStep]:
        steps = list(quick_fit(model, job))
        while not self.may_end.is_set():
            weight = torch.ones(2, requires_grad=True)
            (weight * weight).sum().backward()
            yield steps[0]
        yield from steps


def blocks(photo: Path, names: str) -> list[Path]:
    """Copies of a photo."""
    paths = [photo.with_name(f"block {name}.png") for name in names]
    for path in paths:
        path.write_bytes(photo.read_bytes())
    return paths


@pytest.mark.parametrize("times", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_photos_dropped_beside_an_object_with_photo_detail_are_all_fitted(
    drive: Drive, real_backend: Backend, model: Model, photo: Path, times: int
) -> None:
    fit = LearningFit()

    def act(window: Driver) -> None:
        session, objects = window.session, window.session.editor.objects
        for number in range(times):
            fit.may_end.clear()
            for path in blocks(photo, "abcd"):
                window.context.drop([str(path)])
            detailed = objects[objects.add(fitted(model))].instance
            # The object's tile compares its photo with a render between steps of the fit.
            window.wait(lambda: session.thumbnails.of_object(detailed) is not None or not session.fitting.running)  # noqa: B023
            fit.may_end.set()
            window.wait(lambda: not session.fitting.running)
            assert session.messages.errors == []
            assert not session.fitting.pending
            assert len(objects.added) == 5 * (number + 1)

    drive(act, replace(real_backend, fit=fit, frame_photo=quick_photo))


def failing_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
    """Ends for want of memory after three steps."""
    yield from list(quick_fit(model, job))[:3]
    raise MemoryError


def failing_photo(cut: CutOut, model: Model, source: PhotoSource) -> Photo:
    raise RuntimeError("element 0 of tensors does not require grad")


@pytest.mark.parametrize("fault", [{"fit": failing_fit}, {"frame_photo": failing_photo}])
def test_a_failed_fit_keeps_photo_and_cut_out_to_try_again(
    drive: Drive, both: Backend, photo: Path, fault: dict[str, object]
) -> None:
    def act(window: Driver) -> None:
        session, fitting = window.session, window.session.fitting
        working = session.jobs.backend
        session.jobs.backend = replace(working, **fault)  # type: ignore[arg-type]
        window.context.drop([str(photo)])
        window.wait(lambda: bool(fitting.questions))
        photo.unlink()  # a photo in the clipboard, or on a stick that is pulled out
        window.click("Photo/###as chairs")
        window.wait(lambda: not fitting.running)
        window.wait()
        assert session.messages.errors, "the reason is said"
        assert window.exists("Library/**/waits block.png")
        assert window.exists("Photo/photo")
        window.click("Library/**/show object 5")
        assert not window.exists("Photo/###try again"), "the panel is about the object on screen"
        window.click("Library/**/waits block.png")
        session.jobs.backend = working
        window.click("Photo/###try again")
        window.wait(lambda: not fitting.running)
        assert session.editor.objects.own == ["block"]
        assert session.editor.model.category == "chairs"
        assert not fitting.pending

    drive(act, replace(both, cut_out=doubted))


@in_window()
def test_a_photo_that_cannot_be_read_is_tried_again_or_removed(window: Driver, photo: Path) -> None:
    fitting, content = window.session.fitting, photo.read_bytes()
    photo.unlink()
    for answer in ("try again", "remove waiting"):
        window.context.drop([str(photo)])
        window.wait(lambda: bool(fitting.questions))
        window.click("Library/**/waits block.png", 1)
        photo.write_bytes(content)
        window.click(f"**/###{answer}")
        window.wait(lambda: not fitting.pending)
        photo.unlink()
    assert window.session.editor.objects.own == ["block"]


@in_window()
def test_a_hand_made_cut_out_is_fitted_without_the_file(window: Driver, photo: Path) -> None:
    segmenting, fitting = window.session.segmenting, window.session.fitting
    segmenting.open((PhotoSource(photo),), 0)
    window.wait(lambda: segmenting.settled)
    segmenting.set_hints(Hints(box=(0.2, 0.1, 0.8, 0.9)))
    window.wait(lambda: segmenting.settled)
    photo.unlink()
    window.click("**/###fit segmentation")
    window.wait(lambda: not fitting.running)
    assert window.session.editor.objects.own == ["block"]


def test_photos_dropped_beside_a_question_show_their_state_at_once(drive: Drive, both: Backend, photo: Path) -> None:
    goes_on = threading.Event()

    def slow(path: Path, hints: Hints | None) -> CutOut:
        if path == photo:
            return doubted(path, hints)
        goes_on.wait()
        return read_cut_out(path, hints)

    def act(window: Driver) -> None:
        fitting = window.session.fitting
        window.context.drop([str(photo)])
        window.wait(lambda: bool(fitting.questions))
        assert window.exists("Photo/###this one")
        window.click(f"Library/###{window.session.models.of_category('cars').fingerprint}")
        try:
            for path in blocks(photo, "bc"):
                window.context.drop([str(path)])
            window.ctx.yield_(3)
            for panel in ("Library", "Photo"):
                assert all(window.exists(f"{panel}/**/waits block{name}.png") for name in ("", " b", " c")), panel
            assert window.exists("Photo/###stop fit"), "the photo that was dropped last is looked at"
            window.click("Photo/**/waits block.png")
            assert window.exists("Photo/###this one")
        finally:
            goes_on.set()
        window.wait(lambda: len(fitting.pending) == 1)
        assert window.exists("Photo/###this one")

    drive(act, replace(both, cut_out=slow, fit=quick_fit))
