from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.fitting.fit import FitJob, FitStep
from core.models.model import Model
from core.photos.photo import Photo
from core.photos.segmentation import CutOut
from tests.viewer.driver import deliver, finish, fit, press
from tests.viewer.stand_ins import CheckedFit, block, broken_fit, endless_fit, quick_fit, quick_photo
from viewer.editor import Editor
from viewer.services.messages import MessageKind
from viewer.session import Session
from viewer.values.fit_history import PhotoSource


def test_a_fit_joins_the_objects_and_becomes_current(session: Session, editor: Editor, model: Model, photo: Path):
    initial_state = editor.state
    fit(session, photo)
    assert editor.scene.instance == model[3]
    assert editor.scene.camera.azimuth == pytest.approx(1.0)
    assert editor.scene.camera.width == model.image_size
    assert editor.objects.own[0] == "block"
    assert editor.state.mix.a == ("block", "block")
    session.thumbnails.of_object(editor.objects["block"].instance)
    finish(session)
    assert session.thumbnails.of_object(editor.objects["block"].instance)
    assert len(session.fitting.history.steps) == 10
    assert session.fitting.history.photo is not None
    assert session.fitting.view.camera == editor.scene.camera
    assert session.fitting.history.progress == 1.0
    editor.undo()
    assert editor.state == initial_state
    assert "block" in editor.objects.own


def test_a_stopped_fit_keeps_its_newest_step(session: Session, editor: Editor, photo: Path) -> None:
    session.jobs.backend = replace(session.jobs.backend, fit=endless_fit)
    session.fitting.start(photo)
    deliver(session, lambda: len(session.fitting.history.steps) > 4)
    assert session.fitting.running
    session.fitting.stop()
    finish(session)
    assert not session.fitting.running
    assert editor.scene.instance == session.fitting.history.steps[-1].instance
    assert editor.scene.instance.detail is not None, "the photo's detail"
    assert editor.objects.own[0] == "block"


def test_the_view_follows_a_fit_until_a_person_changes_the_scene(session: Session, editor: Editor, photo: Path) -> None:
    session.jobs.backend = replace(session.jobs.backend, fit=endless_fit)
    scene_frame = session.viewport.frame
    session.viewport.change(panel=(300, 200))
    session.fitting.start(photo)
    deliver(session, lambda: session.viewport.source == "fit")
    assert session.viewport.following
    assert session.viewport.frame is not scene_frame
    assert session.viewport.frame.resolution[0] > session.viewport.frame.resolution[1]
    session.viewport.pan_by(0.1, 0.0)
    assert session.viewport.following
    assert not session.jobs.busy("view")
    editor.sample()
    assert not session.viewport.following
    editor.undo()
    assert session.viewport.following
    session.fitting.stop()
    finish(session)
    assert not session.viewport.following


@pytest.mark.parametrize("resumes", [True, False])
def test_a_fit_that_fails_changes_nothing(session: Session, editor: Editor, photo: Path, resumes: bool) -> None:
    fit(session, photo)
    history = editor.history
    names = editor.objects.own
    finished = session.fitting.history
    session.jobs.backend = replace(session.jobs.backend, fit=broken_fit)
    session.fitting.resume() if resumes else session.fitting.start(photo)
    finish(session, lambda: not session.fitting.running)
    assert editor.history is history
    assert editor.objects.own == names
    assert session.fitting.history is finished
    assert session.messages.errors == ["Cannot fit this image: the loss is not finite"]


def test_a_fit_is_begun_again_and_resumed(session: Session, photo: Path) -> None:
    fitting = session.fitting
    fitting.resume()
    fitting.view.show_photo(1)
    assert not fitting.running
    fit(session, photo)
    fitting.refit()
    finish(session, lambda: not fitting.running)
    assert len(fitting.history.steps) == 10
    steps = fitting.history.steps
    fitting.resume()
    finish(session, lambda: not fitting.running)
    assert fitting.history.steps[:10] == steps and len(fitting.history.steps) == 20
    seconds = [step.seconds for step in fitting.history.steps]
    assert seconds == sorted(seconds)
    assert fitting.history.last.cameras == steps[-1].cameras


def test_files_without_an_image_change_nothing(
    session: Session, editor: Editor, photo: Path, bad_files: dict[str, Path]
) -> None:
    fit(session, photo)
    undo_history = editor.history
    history = session.fitting.history
    for path in bad_files.values():
        session.messages.all.clear()
        fit(session, path)
        assert editor.history is undo_history
        assert session.fitting.history is history
        assert session.messages.newest.kind is MessageKind.PROBLEM, path.name
        assert "Traceback" not in session.messages.errors[0]


def test_a_photo_chosen_for_a_fit_is_not_added_to_another(session: Session, photo: Path) -> None:
    fit(session, photo)
    first = session.fitting.history
    session.fitting.start(photo)
    session.fitting.add_photo(first, photo)
    assert len(session.fitting.history.sources) == 1
    finish(session, lambda: not session.fitting.pending)
    session.editor.show_object("block, 2 photos")
    session.tick()
    assert len(session.fitting.shown.sources) == 2


def test_dropped_photos_can_become_an_object_each_or_join_the_shown_object(session: Session, photo: Path) -> None:
    fitting = session.fitting
    fitting.start(block(photo, "a"), block(photo, "b"))
    press(session, "An object each")
    assert [len(request.history.sources) for request in fitting.pending] == [1, 1]
    finish(session, lambda: not fitting.pending)
    fitting.start(block(photo, "c"))
    press(session, "Another photo of")
    finish(session, lambda: not fitting.pending)
    assert [source.path.stem for source in fitting.history.sources] == ["block a", "block c"]


def test_photos_join_and_leave_an_object_without_a_search(session: Session, photo: Path) -> None:
    fitting = session.fitting
    jobs: list[FitJob] = []

    def noting(model: Model, job: FitJob) -> Iterator[FitStep]:
        jobs.append(job)
        return (replace(step, left_out=(1,) if len(jobs) == 1 else ()) for step in quick_fit(model, job))

    session.jobs.backend = replace(session.jobs.backend, fit=noting)
    fit(session, block(photo, "a"), block(photo, "b"))
    fitting.add_photo(fitting.history, block(photo, "c"))
    finish(session, lambda: not fitting.pending)
    fitting.refine(fitting.history, without=(0,))
    finish(session, lambda: not fitting.pending)
    assert [source.path.stem for source in fitting.history.sources] == ["block c"]
    assert [job.resume_from and len(job.resume_from.cameras) for job in jobs] == [None, 1, 1]
    assert [len(job.added) for job in jobs] == [0, 1, 0]
    assert jobs[1].settings.steps == jobs[0].settings.steps > jobs[2].settings.steps


def test_all_files_that_are_no_photos_are_one_message(session: Session, photo: Path) -> None:
    words = [photo.with_name(f"diary {number}.txt") for number in range(5)]
    for path in words:
        path.write_text("words")
    session.fitting.start(*words, photo)
    (message,) = session.messages.all
    assert message.text == "5 of 6 are no photos: diary 0.txt, diary 1.txt, diary 2.txt, …"
    assert [request.history.name for request in session.fitting.pending] == ["block"]
    session.fitting.start(*words)
    assert len(session.fitting.pending) == 1 and session.messages.newest.kind is MessageKind.PROBLEM


def test_a_photo_that_was_left_out_can_be_fitted_by_itself(session: Session, photo: Path) -> None:
    def leaving_out(model: Model, job: FitJob) -> Iterator[FitStep]:
        steps = quick_fit(model, job)
        return (replace(step, left_out=(1,) if len(job.photos) > 1 else ()) for step in steps)

    fitting = session.fitting
    session.jobs.backend = replace(session.jobs.backend, fit=leaving_out)
    fit(session, block(photo, "a"), block(photo, "b"))
    assert session.messages.newest.text == "Left out, as another object: block b.png"
    press(session, "Fit by itself")
    finish(session, lambda: not fitting.pending)
    assert [source.path.stem for source in fitting.history.sources] == ["block b"]


def test_photos_dropped_during_a_fit_wait(session: Session, editor: Editor, photo: Path, bad_files: dict[str, Path]):
    fitting = session.fitting
    for path in (photo, block(photo, "b"), bad_files["text.png"], block(photo, "c")):
        fitting.start(path)
    assert [request.history.name for request in fitting.waiting.requests] == ["block b", "block c"]
    finish(session, lambda: not fitting.running)
    assert {added.name for added in editor.objects.added} == {"block", "block b", "block c"}
    assert len(session.messages.errors) == 1
    assert fitting.pending == ()  # what is no photo becomes no tile
    assert editor.state.mix.a.shape == "block"  # what is being edited stays
    assert set(fitting.results.unseen) == {"block b", "block c"}
    editor.show_object("block c")
    assert editor.state.mix.a.shape == "block c"
    assert set(fitting.results.unseen) == {"block b"}
    editor.sample()
    editor.show_object("block b")
    assert not fitting.results.unseen


def test_stopping_a_fit_begins_the_next_one(session: Session, photo: Path) -> None:
    session.jobs.backend = replace(session.jobs.backend, fit=endless_fit)
    fitting = session.fitting
    fitting.start(photo)
    fitting.start(block(photo, "b"))
    fitting.start(block(photo, "c"))
    deliver(session, lambda: len(fitting.history.steps) > 3)
    fitting.stop()
    assert fitting.history.name == "block b"
    fitting.forget(fitting.waiting.requests[0].history.sources)
    deliver(session, lambda: len(fitting.history.steps) > 3)
    fitting.stop()
    assert not fitting.running


def test_the_fit_of_the_object_in_the_view_is_shown_beside_another_that_runs(session: Session, photo: Path) -> None:
    fitting = session.fitting
    assert not fitting.shown.sources
    fit(session, photo)
    session.jobs.backend = replace(session.jobs.backend, fit=endless_fit)
    fitting.start(second := block(photo, "b"))
    deliver(session, lambda: len(fitting.history.steps) > 3)
    assert fitting.shown.sources[0].path == second  # it is followed
    session.editor.show_object("object 5")
    assert not fitting.shown.sources
    session.editor.show_object("block")
    assert fitting.shown.sources[0].path == photo
    fitting.stop()
    session.tick()
    assert fitting.shown is fitting.history
    assert fitting.shown.sources[0].path == photo
    session.editor.show_object("block b")
    session.tick()
    assert fitting.shown.sources[0].path == second


def test_a_result_does_not_replace_an_object_being_edited(session: Session, editor: Editor, photo: Path) -> None:
    session.jobs.backend = replace(session.jobs.backend, fit=endless_fit)
    session.fitting.start(photo)
    deliver(session, lambda: len(session.fitting.history.steps) > 3)
    editor.show_object("object 5")
    edited_state = editor.state
    session.fitting.stop()
    assert editor.state is edited_state
    assert editor.objects.own[0] == "block"
    assert "block" in session.fitting.results.unseen
    editor.show_object("block")
    assert editor.state.mix.a.shape == "block"


def test_the_first_result_can_be_used_while_it_is_checked(session: Session, editor: Editor, model: Model, photo: Path):
    fit = CheckedFit()
    session.jobs.backend = replace(session.jobs.backend, fit=fit)
    fitting = session.fitting
    fitting.start(photo)
    deliver(session, lambda: fitting.results.checking is not None)
    assert fitting.running
    assert editor.scene.instance == model[3]
    assert editor.state.mix.a.shape == "block"
    assert fitting.pending == ()
    fit.may_end.set()
    finish(session, lambda: not fitting.running)
    assert editor.objects["block"].instance == model[4]
    assert editor.scene.instance == model[4]  # nobody has edited it
    assert editor.scene.camera.azimuth == pytest.approx(1.0 + np.pi, abs=0.02)
    assert [added.name for added in editor.objects.added] == ["block"]
    assert "a better viewpoint was found" in session.messages.all[-1].text
    editor.undo()
    assert editor.scene.instance == model[3]


def test_a_better_result_waits_where_the_first_was_edited(session: Session, editor: Editor, model: Model, photo: Path):
    fit = CheckedFit()
    session.jobs.backend = replace(session.jobs.backend, fit=fit)
    session.fitting.start(photo)
    deliver(session, lambda: session.fitting.results.checking is not None)
    editor.sample()
    edited_state = editor.state
    fit.may_end.set()
    finish(session, lambda: not session.fitting.running)
    assert editor.state is edited_state
    editor.show_object("block")
    assert editor.scene.instance == model[4]


def test_a_first_result_that_nothing_beats_stays_as_it_is(session: Session, editor: Editor, photo: Path) -> None:
    def agreeing(model: Model, job: FitJob) -> Iterator[FitStep]:
        steps = list(quick_fit(model, job))
        yield from steps
        yield replace(steps[-1], restart=True)
        yield replace(steps[-1], restart=True, margin=0.5)

    session.jobs.backend = replace(session.jobs.backend, fit=agreeing)
    session.fitting.start(photo)
    deliver(session, lambda: session.fitting.results.checking is not None or not session.fitting.running)
    finish(session, lambda: not session.fitting.running)
    assert len(editor.history.past) == 1
    assert not session.fitting.results.unseen
    assert session.messages.all == []
    assert editor.objects["block"].confidence == session.fitting.history.last.confidence


def test_a_message_names_the_fitted_image_of_a_file_with_several(session: Session, photo: Path) -> None:
    def noted(cut: CutOut, model: Model, source: PhotoSource) -> Photo:
        return replace(quick_photo(cut, model, source), note="image 2 of the 3 in this file is used")

    session.jobs.backend = replace(session.jobs.backend, frame_photo=noted)
    fit(session, photo)
    assert "image 2 of the 3" in session.messages.newest.text
