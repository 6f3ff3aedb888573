import shutil
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from core.fitting.fit import FitJob, FitStep
from core.models.model import Model
from core.photos.photo import Photo, read_cut_out
from core.photos.segmentation import CutOut, Hints
from tests.viewer.driver import Drive, Driver, in_window
from tests.viewer.stand_ins import block, broken_fit, doubted, endless_fit, quick_fit, quick_photo
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


@pytest.mark.parametrize("times", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_photos_dropped_beside_an_object_with_photo_detail_are_all_fitted(
    drive: Drive, real_backend: Backend, model: Model, photo: Path, times: int
) -> None:
    fit = LearningFit()

    def act(window: Driver) -> None:
        session = window.session
        objects = window.editor.objects
        for number in range(times):
            fit.may_end.clear()
            for path in [block(photo, name) for name in "abcd"]:
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


def failing_photo(cut: CutOut, model: Model, source: PhotoSource) -> Photo:
    raise RuntimeError("element 0 of tensors does not require grad")


@pytest.mark.parametrize("fault", [{"fit": broken_fit}, {"frame_photo": failing_photo}])
@in_window("both", cut_out=doubted)
def test_a_failed_fit_keeps_photo_and_cut_out_to_try_again(
    window: Driver, photo: Path, fault: dict[str, object]
) -> None:
    working = window.session.jobs.backend
    window.session.jobs.backend = replace(working, **fault)  # type: ignore[arg-type]
    window.ask_about(photo)
    photo.unlink()  # a photo in the clipboard, or on a stick that is pulled out
    window.click("Photo/###as chairs")
    window.wait(lambda: not window.fitting.running)
    window.wait()
    assert window.session.messages.errors, "the reason is said"
    assert window.exists("Library/**/waits block.png")
    assert window.exists("Photo/photo")
    window.click("Library/**/show object 5")
    assert not window.exists("Photo/###try again"), "the panel is about the object on screen"
    window.click("Library/**/waits block.png")
    window.session.jobs.backend = working
    window.click("Photo/###try again")
    window.wait(lambda: not window.fitting.running)
    assert window.session.editor.objects.own == ["block"]
    assert window.session.editor.model.category == "chairs"
    assert not window.fitting.pending


@in_window()
def test_a_photo_that_cannot_be_read_is_tried_again_or_removed(window: Driver, photo: Path) -> None:
    content = photo.read_bytes()
    photo.unlink()
    for button, answer in ((0, "Photo/###try again"), (1, "**/###remove waiting")):
        window.fitting.fit(PhotoSource(photo))
        window.wait(lambda: bool(window.fitting.questions))
        window.click("Library/**/waits block.png", button)
        photo.write_bytes(content)
        window.click(answer)
        window.wait(lambda: not window.fitting.pending)
        photo.unlink()
    assert window.editor.objects.own == ["block"]


@in_window()
def test_a_hand_made_cut_out_is_fitted_without_the_file(window: Driver, photo: Path) -> None:
    segmenting = window.session.segmenting
    segmenting.open((PhotoSource(photo),), 0)
    window.wait(lambda: segmenting.settled)
    segmenting.set_hints(Hints(box=(0.2, 0.1, 0.8, 0.9)))
    window.wait(lambda: segmenting.settled)
    photo.unlink()
    window.click("**/###fit segmentation")
    window.wait(lambda: not window.fitting.running)
    assert window.editor.objects.own == ["block"]


def test_photos_dropped_beside_a_question_show_their_state_at_once(drive: Drive, both: Backend, photo: Path) -> None:
    goes_on = threading.Event()

    def slow(path: Path, hints: Hints | None) -> CutOut:
        if path.name == photo.name:
            return doubted(path, hints)
        goes_on.wait()
        return read_cut_out(path, hints)

    def act(window: Driver) -> None:
        fitting = window.fitting
        window.context.drop([str(photo)])
        window.wait(lambda: bool(fitting.questions))
        assert window.exists("Photo/###this one")
        window.click(f"Library/###{window.session.models.of_category('cars').fingerprint}")
        try:
            for path in (block(photo, "b"), block(photo, "c")):
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


def killed(folder: Path) -> Path:
    """Return a copy of a session's folder, as a killed program leaves it: without its locks."""
    copy = folder.with_name(f"{folder.name} killed")
    shutil.copytree(folder, copy, ignore=shutil.ignore_patterns(".*"))
    return copy


@pytest.mark.parametrize("asked", [False, True])
def test_a_photo_that_waits_is_fitted_as_dropped_though_its_file_changes_and_the_program_is_killed(
    drive: Drive, both: Backend, photo: Path, tmp_path: Path, asked: bool
) -> None:
    changed, gone = (block(photo, name) for name in "bc")
    pixels = read_cut_out(photo, None).pixels
    fitted_pixels = list[np.ndarray]()

    def seen_photo(cut: CutOut, model: Model, source: PhotoSource) -> Photo:
        fitted_pixels.append(cut.pixels)
        return quick_photo(cut, model, source)

    def first(window: Driver) -> None:
        for path in (photo, changed, gone):
            window.context.drop([str(path)])
        window.wait(lambda: len(window.fitting.questions) == 3 if asked else len(window.fitting.history.steps) > 1)
        Image.new("RGB", (96, 96), "green").save(changed)
        gone.unlink()
        window.wait(lambda: window.session.recording.is_up_to_date)
        folders.append(killed(folders[0]))

    def second(window: Driver) -> None:
        if asked:
            window.wait(lambda: len(window.fitting.questions) == 3)
            assert all(window.exists(f"Library/**/waits block{name}.png") for name in ("", " b", " c"))
            for _ in range(3):
                window.click("Photo/###as chairs")
                window.wait(lambda: not window.fitting.running)
        window.wait(lambda: not window.fitting.pending)
        assert window.session.messages.errors == []
        assert {"block", "block b", "block c"} <= set(window.editor.objects.own)

    folders = [tmp_path / "config"]
    backend = replace(both, cut_out=doubted) if asked else both
    drive(first, replace(backend, fit=endless_fit), folder=folders[0])
    drive(second, replace(backend, frame_photo=seen_photo), folder=folders[1])
    assert all(np.array_equal(read, pixels) for read in fitted_pixels)


@in_window("both")
def test_a_chosen_object_takes_the_place_of_a_question_until_its_tile_is_clicked(window: Driver, photo: Path) -> None:
    window.session.jobs.backend = replace(window.session.jobs.backend, fit=broken_fit)
    window.ask_about(photo)
    name = window.editor.state.mix.a.shape
    for cut_out in (read_cut_out, doubted):
        window.session.jobs.backend = replace(window.session.jobs.backend, cut_out=cut_out)
        if cut_out is doubted:
            window.context.drop([str(block(photo, "b"))])
            window.wait(lambda: len(window.fitting.questions) == 2)
        tile = "waits block b.png" if cut_out is doubted else "waits block.png"
        window.click(f"Library/**/{tile}")
        assert window.exists("Photo/###leave photo")
        window.click(f"Library/**/show {name}")
        assert not window.exists("Photo/###leave photo"), "the panel is about the object in the view"
        assert window.exists(f"Library/**/{tile}")


@in_window("both")
def test_photos_that_wait_are_kept_when_a_project_is_opened_or_begun(
    window: Driver, photo: Path, tmp_path: Path
) -> None:
    project = tmp_path / "a.codenerf"
    working = window.session.jobs.backend
    window.click("Library/**/show object 3")
    window.session.save_project(project)
    window.session.jobs.backend = replace(working, fit=broken_fit, cut_out=doubted)
    for path in (photo, block(photo, "b")):
        window.context.drop([str(path)])
    window.wait(lambda: len(window.session.fitting.questions) == 2)
    window.click("Photo/###as chairs")
    window.wait(lambda: any(question.is_failed for question in window.session.fitting.questions))
    window.wait()
    for begin in (lambda: window.context.drop([str(project)]), lambda: window.menu("File/###new_project")):
        begin()
        window.wait()
        assert window.exists("Library/**/waits block.png"), "it failed"
        assert window.exists("Library/**/waits block b.png"), "it is asked about"
    photo.unlink()
    window.session.jobs.backend = working
    window.click("Library/**/waits block.png")
    window.click("Photo/###try again")  # with its cut-out
    window.wait(lambda: not window.session.fitting.running)
    assert window.session.editor.objects.own == ["block"]


def test_a_running_fit_goes_on_when_a_project_is_opened(drive: Drive, backend: Backend, photo: Path, tmp_path: Path):
    fit = LearningFit()

    def act(window: Driver) -> None:
        session = window.session
        project = tmp_path / "a.codenerf"
        window.click("Library/**/show object 3")
        session.save_project(project)
        window.context.drop([str(photo)])
        window.wait(lambda: len(session.fitting.history.steps) > 1)
        window.context.drop([str(project)])
        window.ctx.yield_(3)
        assert window.exists("Library/**/waits block.png")
        fit.may_end.set()
        window.wait(lambda: not session.fitting.pending)
        assert session.editor.objects.own == ["block"]
        assert session.editor.state.mix.a.shape == "object 3", "a person may be editing the project"

    drive(act, replace(backend, fit=fit))
