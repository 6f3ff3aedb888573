"""Photos in question and failed fits wait for a person's answer."""

from dataclasses import replace
from pathlib import Path

from core.photos.photo import read_cut_out
from core.photos.plain_background import NoBackgroundError
from core.photos.segmentation import CutOut, Hints
from tests.viewer.driver import finish, fit, press
from tests.viewer.stand_ins import block, broken_fit, crowded, doubted
from viewer.services.backend import Backend
from viewer.services.worker import Worker
from viewer.session import Session
from viewer.values.fit_history import PhotoSource


def test_a_doubtful_cut_out_waits_for_one_answer_while_the_next_photo_is_fitted(session: Session, photo: Path) -> None:
    session.jobs.backend = replace(session.jobs.backend, cut_out=doubted)
    fitting = session.fitting
    history = session.editor.history
    second = block(photo, "b")
    fit(session, photo)
    assert not fitting.running
    assert session.editor.history is history
    session.jobs.backend = replace(session.jobs.backend, cut_out=read_cut_out)
    fit(session, second)
    assert session.editor.objects.own == ["block b"]
    (question,) = fitting.questions
    assert question.words.startswith("Is the whole object outlined")
    assert [request.history.name for request in fitting.pending] == ["block"]
    edge = question.preview.pixels[:, 48]  # the block is from row 20 to row 80
    assert (edge[20] != (200, 30, 30)).any() and (edge[50] == (200, 30, 30)).all()

    def unread(path: Path, hints: Hints | None) -> CutOut:
        raise AssertionError("it was cut out already")

    session.jobs.backend = replace(session.jobs.backend, cut_out=unread)
    session.answers.answer(question)
    finish(session, lambda: not fitting.pending)
    assert session.editor.objects.own == ["block", "block b"]
    assert session.messages.errors == []


def test_the_category_follows_the_detector_where_the_mask_is_doubtful(worker: Worker, both: Backend, photo: Path):
    session = Session(worker, replace(both, cut_out=doubted), seed=0)
    chairs = session.models.of_category("chairs")
    cars = session.models.of_category("cars")
    fit(session, photo)  # which a look at its colours takes for a chair
    (question,) = session.fitting.questions
    assert question.model == cars.fingerprint
    session.answers.answer(question, chairs.fingerprint)
    finish(session, lambda: not session.fitting.pending)
    assert session.editor.model is chairs
    assert session.editor.objects.own == ["block"]


def test_one_of_several_prominent_objects_is_chosen_by_its_number(session: Session, photo: Path) -> None:
    session.jobs.backend = replace(session.jobs.backend, cut_out=crowded)
    fitting = session.fitting
    hints = list[Hints | None]()
    fit(session, photo)
    (question,) = fitting.questions
    assert question.words.startswith("Which one?")
    assert question.preview.boxes == ((0.0, 0.2, 0.5, 0.8), (0.5, 0.2, 1.0, 0.8))

    def noted(path: Path, photo_hints: Hints | None) -> CutOut:
        hints.append(photo_hints)
        return crowded(path, photo_hints)

    session.jobs.backend = replace(session.jobs.backend, cut_out=noted)
    session.answers.choose(question.request.history.sources, 0, question.preview.boxes[1])
    finish(session, lambda: not fitting.pending)
    assert hints == [Hints(box=(0.5, 0.2, 1.0, 0.8))]
    assert session.editor.objects.own == ["block"]


def test_a_question_is_saved_and_asked_again(session: Session, photo: Path, tmp_path: Path) -> None:
    session.jobs.backend = replace(session.jobs.backend, cut_out=doubted)
    fit(session, photo)
    session.save_project(tmp_path / "a.codenerf")
    session.fitting.forget(session.fitting.pending[0].history.sources)
    assert not session.fitting.pending
    session.open_project(tmp_path / "a.codenerf")
    finish(session)
    (question,) = session.fitting.questions
    session.segmenting.open(question.request.history.sources, 0)
    finish(session, lambda: session.segmenting.settled)
    assert session.fitting.questions  # until the object is pointed out
    session.segmenting.fit()
    assert not session.fitting.questions
    finish(session, lambda: not session.fitting.pending)
    assert session.editor.objects.own == ["block"]


def test_a_failed_fit_is_saved_and_repeated_on_request_alone(session: Session, photo: Path, tmp_path: Path):
    working = session.jobs.backend
    session.jobs.backend = replace(working, fit=broken_fit)
    fit(session, photo)
    session.save_project(tmp_path / "a.codenerf")
    session.fitting.forget(session.fitting.pending[0].history.sources)
    session.new()
    assert not session.fitting.pending
    photo.unlink()
    session.open_project(tmp_path / "a.codenerf")
    finish(session)
    (question,) = session.fitting.questions
    assert question.words == "Cannot fit this photo: the loss is not finite"
    assert session.fitting.question is None, "it is shown when it is chosen"
    session.fitting.ask_first(question.request)
    assert session.fitting.question is question
    session.jobs.backend = working
    session.answers.try_again(question.request)
    finish(session, lambda: not session.fitting.pending)
    assert session.editor.objects.own == ["block"]


def test_a_failed_fit_of_several_photos_is_left_as_a_whole(session: Session, photo: Path) -> None:
    session.jobs.backend = replace(session.jobs.backend, fit=broken_fit)
    fit(session, photo, block(photo, "b"))
    (question,) = session.fitting.questions
    assert len(question.request.history.photos) == 2
    assert question.source.name == "block b.png"
    session.answers.leave(question)
    finish(session)
    assert not session.fitting.pending


def test_a_photo_without_an_object_waits_until_it_is_pointed_at(session: Session, photo: Path) -> None:
    def nothing(path: Path, hints: Hints | None) -> CutOut:
        if hints is None:
            raise NoBackgroundError
        return read_cut_out(path, hints)

    session.jobs.backend = replace(session.jobs.backend, cut_out=nothing)
    fit(session, photo)
    (question,) = session.fitting.questions
    assert (question.cut, question.preview.boxes) == (None, ())
    assert question.words.startswith("The object was not found")
    assert session.messages.errors == []
    session.fitting.fit(question.source._replace(hints=Hints()))
    finish(session, lambda: not session.fitting.pending)
    assert session.editor.objects.own == ["block"]


def test_a_photo_of_another_category_among_several_is_a_question(session: Session, photo: Path) -> None:
    second = block(photo, "other")
    text_file = photo.with_name("block.txt")
    text_file.write_bytes(b"moving")
    guesses = iter(({"chairs": 0.9, "boats": 0.1}, {"chairs": 0.1, "boats": 0.9}))
    session.jobs.backend = replace(session.jobs.backend, guess_category=lambda _: next(guesses))
    fit(session, photo, text_file, second)
    assert session.messages.newest.text == "2 photos are fitted as one object. 1 of 3 are no photos: block.txt"
    (question,) = session.fitting.questions
    assert question.source.path == second
    assert question.words.startswith("This looks like a boat, the first image like a chair")
    session.answers.leave(question)
    finish(session, lambda: not session.fitting.running)
    assert not session.fitting.questions
    assert [fitted.source.path for fitted in session.fitting.shown.photos] == [photo]


def test_failed_fits_are_removed_together_and_come_back_by_undo(session: Session, photo: Path) -> None:
    fitting = session.fitting
    session.jobs.backend = replace(session.jobs.backend, fit=broken_fit)
    fitting.fit_each(tuple(PhotoSource(block(photo, name)) for name in "ab"))
    finish(session, lambda: not fitting.running)
    assert [question.is_failed for question in fitting.questions] == [True, True]
    fitting.remove_failed()
    assert fitting.pending == ()
    press(session, "Undo")
    assert [question.source.name for question in fitting.questions] == ["block a.png", "block b.png"]
