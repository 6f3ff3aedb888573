"""Sessions from launch to launch: closed, crashed, beside each other, damaged."""

import random
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageOps

from core.models.model import Instance
from core.models.photo_detail import Erasure
from tests.conftest import random_model
from tests.viewer.driver import deliver, finish, fit, keep
from tests.viewer.stand_ins import Clock, block, detailed_fit, endless_fit
from viewer.activities import recording
from viewer.services.backend import Backend
from viewer.services.worker import Worker
from viewer.session import Session
from viewer.store import store as store_module
from viewer.store.store import FILE, SILENCE, Store
from viewer.values.objects import EditableObject

Launch = Callable[..., Session]


@pytest.fixture
def launch(worker: Worker, backend: Backend, tmp_path: Path) -> Launch:
    """Opens a session that keeps itself in ``tmp_path``, and goes on with the last one, which is closed first."""

    def begin(backend: Backend = backend, display: str = "", last: Session | None = None) -> Session:
        if last:
            last.recording.close()
        session = Session(worker, backend, 1, tmp_path, display=display)
        session.resume()
        return session

    return begin


def shapes(session: Session) -> list[str]:
    """Names of the objects A of all states."""
    return [state.mix.a.shape for state in session.editor.history.states]


def test_the_next_launch_goes_on_with_objects_of_every_model(launch: Launch, photo: Path, both: Backend) -> None:
    session = launch(both)
    fit(session, photo)
    session.editor.set_b("object 4")
    session.editor.mix_both(0.0, 0.4)
    session.editor.show_object("car 2")
    made = session.editor.history
    session.save_project(session.project_path or photo.with_suffix(".codenerf"))
    session = launch(both, last=session)
    assert session.editor.history == made
    assert session.editor.model.category == "cars"
    assert session.editor.objects.own == ["block"]
    assert session.project_path == photo.with_suffix(".codenerf")
    assert session.messages.errors == []


def test_objects_can_be_corrected_after_a_restart(launch: Launch, backend: Backend, photo: Path, tmp_path: Path):
    """And so can a version of it; its photo is there though its file is gone."""
    session = launch(replace(backend, fit=detailed_fit))
    sizes = {"block tall": (90, 110), "block wide": (120, 100)}
    fits = []
    for name, size in sizes.items():
        path = tmp_path / f"{name}.png"
        with Image.open(photo) as image:
            ImageOps.pad(image, size, color="white").save(path)
        fit(session, path)
        fits.append(session.fitting.shown)
        path.unlink()
    session = launch(replace(backend, fit=detailed_fit), last=session)
    for (name, (width, height)), made in zip(sizes.items(), fits, strict=True):
        objects = session.editor.objects
        session.editor.show_object(objects.version(name, objects[name].instance.with_texture(session.editor.model[3])))
        finish(session, lambda: bool(session.fitting.shown.sources))
        history = session.fitting.shown
        assert history is session.fitting.history
        assert [step.psnr for step in history.steps] == [step.psnr for step in made.steps]
        assert (history.last.runner_up, history.last.confidence) == (made.last.runner_up, made.last.confidence)
        assert len(history.last.hypotheses) == len(made.last.hypotheses) and history.resume_point
        assert history.last.instance == made.last.instance
        assert session.whole_photo.shape == (height, width, 3)
        session.segmenting.open(history.sources, 0)
        finish(session, lambda: session.segmenting.settled)
    session.fitting.refit()
    finish(session, lambda: not session.fitting.pending)
    session.fitting.add_photo(session.fitting.shown, photo)
    finish(session, lambda: not session.fitting.pending)
    assert len(session.fitting.shown.photos) == 2 and session.messages.errors == []
    session.editor.show_object("object 3")
    assert session.whole_photo is None and not session.fitting.shown.sources


def test_a_fit_under_way_and_those_that_wait_go_on(launch: Launch, backend: Backend, photo: Path) -> None:
    second = block(photo, "other")
    session = launch(replace(backend, fit=endless_fit))
    session.fitting.start(photo)
    session.fitting.start(second)
    deliver(session, lambda: len(session.fitting.history.steps) > 3)
    session.recording.close()
    photo.unlink()
    second.unlink()
    session = launch()
    assert session.fitting.running and len(session.fitting.waiting.requests) == 1
    finish(session, lambda: not session.fitting.pending)
    assert session.messages.errors == []
    assert session.editor.objects.own == ["block other", "block"]


def test_forty_photos_that_wait_are_kept(launch: Launch, backend: Backend, photo: Path) -> None:
    paths = [photo.with_name(f"block {number}.png") for number in range(40)]
    for number, path in enumerate(paths):
        Image.new("RGB", (96, 96), (number, 0, 0)).save(path)
    session = launch(replace(backend, fit=endless_fit))
    session.fitting.start(*paths)
    keep(session)
    for path in paths:
        path.unlink()
    pending = launch(replace(backend, fit=endless_fit)).fitting.pending
    assert [request.history.sources[0].path.name for request in pending] == [path.name for path in paths]
    assert all(request.history.sources[0].file.is_file() for request in pending)


def test_an_edit_is_kept_between_drags(launch: Launch, tmp_path: Path) -> None:
    session = launch()
    session.tick()
    assert session.recording.is_up_to_date and not statuses(tmp_path)  # nothing was made yet
    session.editor.mix_both(0.5, 0.4, gesture="mix pad")
    session.tick()
    assert not session.recording.is_up_to_date and not statuses(tmp_path)
    session.editor.end_gesture()
    keep(session)
    assert statuses(tmp_path) == ["open"]
    assert launch(last=session).editor.state.mix.texture == 0.4


def statuses(folder: Path) -> list[str]:
    """The status of each session, the newest first."""
    with closing(sqlite3.connect(folder / FILE)) as connection:
        return [status for (status,) in connection.execute("SELECT status FROM sessions ORDER BY changed DESC")]


def test_a_session_that_ended_the_program_twice_is_not_opened(launch: Launch) -> None:
    for name in ("object 2", "object 3"):
        session = launch()
        session.editor.show_object(name)
        keep(session)  # and is killed
    session = launch()
    session.tick()
    assert not session.editor.history.past
    assert "crashed twice" in session.messages.newest.text
    (earlier,) = session.store.earlier
    session.open_earlier(earlier)
    assert session.messages.newest is None
    assert shapes(session)[1:] == ["object 2", "object 3"]
    assert launch(last=session).editor.history.past


def test_earlier_sessions_are_named_by_their_newest_object(launch: Launch, photo: Path) -> None:
    session = launch()
    fit(session, photo)
    session.new()
    session.editor.show_object("object 2")
    session.new()
    keep(session)
    assert [earlier.name.partition(",")[0] for earlier in session.store.earlier] == ["Session", "block"]
    assert len({earlier.name for earlier in session.store.earlier}) == 2


def test_of_two_windows_neither_session_is_lost_nor_an_object(launch: Launch, photo: Path) -> None:
    windows = [launch(display=display) for display in "ab"]
    for number, session in enumerate(windows):
        fit(session, photo)  # under the same name
        session.rename(session.editor.objects.version("block", session.editor.model[number]), "version")
        session.editor.show_object(f"object {number + 2}")
        keep(session)
    for session in windows:
        session = launch(last=session)
    assert shapes(session)[-1] == "object 3"
    assert session.editor.objects.own == ["block (2)", "block"]
    for number, name in enumerate(("block", "block (2)")):
        version = session.editor.objects.versions(name)[1]
        assert session.editor.objects[version].instance == session.editor.model[number]
    (earlier,) = session.store.earlier
    session.open_earlier(earlier)
    assert shapes(session)[-1] == "object 2" and shapes(session)[1] == "block"


def test_a_session_of_a_window_that_is_silent_goes_on_elsewhere_and_both_are_kept(
    worker: Worker, backend: Backend, tmp_path: Path, clock: Clock
) -> None:
    """As while a laptop slept with one window open on each of two displays."""
    asleep = Store(tmp_path, "a", clock)
    project = Session(worker, backend, 1).project()
    history = project.history.changed(replace(project.history.now, removed=frozenset("a")))
    asleep.write(replace(project, history=history))
    assert asleep.mine()[0] == ()  # and waits
    awake = Store(tmp_path, "b", clock)
    assert awake.resume() is None
    clock.now += SILENCE + 1
    number = awake.resume()
    assert number is not None
    asleep.write(replace(project, history=history.changed(project.history.now)))
    awake.write(replace(project, history=history))
    assert asleep.mine() == awake.mine()
    assert len(awake.session(number, project.history.now).history.steps) == 2
    assert len(awake.session(number + 1, project.history.now).history.steps) == 3


def test_of_several_sessions_the_newest_goes_on_and_the_others_are_earlier(launch: Launch) -> None:
    windows = [launch(display=display) for display in "abc"]
    for number, session in enumerate(windows):
        session.editor.show_object(f"object {number + 2}")
        keep(session)
    windows[0].recording.close()
    session = launch(display="b")  # c is alive
    assert shapes(session)[-1] == "object 2"  # it was closed last
    (earlier,) = session.store.earlier
    session.open_earlier(earlier)
    assert shapes(session)[-1] == "object 3"


def test_new_archives_the_session_and_keeps_fitted_objects(launch: Launch, photo: Path) -> None:
    session = launch()
    fit(session, photo)
    session.editor.objects.add(EditableObject("never shown", session.editor.model[3]))
    session.editor.mix_both(0.0, 0.4)
    history = session.editor.history
    session.new()
    assert not session.editor.history.past
    assert session.editor.objects.own == ["block"]
    session.new()
    session.editor.show_object("block")
    session.editor.edit(session.editor.scene.instance.with_texture(session.editor.model[5]))
    edited = session.editor.scene.instance
    keep(session)
    (earlier,) = session.store.earlier  # nothing had been made the second time
    session.open_earlier(earlier)
    assert session.editor.history == history
    assert session.editor.objects.own == ["never shown", "block"]
    assert edited in session.editor.objects.states("block")
    session.new()
    assert not launch(last=session).editor.history.past


def test_few_earlier_sessions_are_kept(launch: Launch, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store_module, "EARLIER", 2)
    session = launch()
    for number in range(2, 6):
        session.editor.show_object(f"object {number}")
        session.new()
    keep(session)
    assert len(session.store.earlier) == 2
    session.open_earlier(session.store.earlier[0])
    assert shapes(session)[-1] == "object 5"


def test_removed_objects_come_back_by_undo_at_the_next_launch_until_new(launch: Launch, photo: Path) -> None:
    session = launch()
    fit(session, photo)
    session.rename("block", "Red chair")
    session.new()
    session.remove("Red chair")
    session = launch(last=session)
    assert session.editor.objects.own == []
    session.editor.undo()
    assert session.editor.objects.own == ["Red chair"]
    session.editor.redo()
    session.new()
    assert session.editor.objects.own == []
    session = launch(last=session)
    assert session.editor.objects.ever_added == ()
    session.open_earlier(session.store.earlier[0])
    session.editor.undo()
    assert session.editor.objects.own == ["Red chair"]


def test_states_and_objects_of_a_replaced_model_wait_for_it(launch: Launch, backend: Backend, photo: Path) -> None:
    session = launch()
    fit(session, photo)
    session.editor.show_object("object 2")
    made = session.editor.history
    session = launch(replace(backend, load_model=lambda name: random_model(9)), last=session)
    editor = session.editor
    assert editor.history.past == made.states and editor.objects.can_show(editor.state)
    assert "waits in Mine" in session.messages.newest.text
    assert editor.objects.is_missing("block")
    editor.undo()
    assert editor.objects.can_show(editor.state)
    session = launch(last=session)
    assert session.editor.state == made.now and not session.editor.objects.is_missing("block")


def test_objects_last_when_their_model_is_extended(launch: Launch, backend: Backend, photo: Path) -> None:
    session = launch()
    fit(session, photo)
    instance = session.editor.scene.instance
    session.recording.close()
    extended = replace(random_model(7), extends=(instance.fingerprint,))
    for _ in range(2):
        session = launch(replace(backend, load_model=lambda name: extended))
        assert session.editor.objects["block"].instance == Instance(extended, instance.codes)
        session.recording.close()


def test_undo_after_many_strokes_is_small(launch: Launch, tmp_path: Path, backend: Backend, photo: Path) -> None:
    """Each state holds all strokes that were drawn before it; the file has each stroke once."""
    session = launch(replace(backend, fit=detailed_fit))
    fit(session, photo)
    editor = session.editor
    numbers = random.Random(0)
    for _ in range(100):
        detail = editor.scene.instance.detail
        points = tuple((numbers.random(), numbers.random()) for _ in range(40))
        editor.set_detail(detail.erasing(0, (*detail.views[0].erased, Erasure(points, 0.04))))
        for _ in range(4):
            editor.mix_both(0.0, numbers.random())
    made = editor.history
    session.recording.close()
    assert (tmp_path / FILE).stat().st_size < 3_000_000
    session = launch()
    assert session.editor.history == made
    first, last = (session.editor.history.states[index].scene.instance.detail for index in (-10, -1))
    assert first.views[0].erased[0] is last.views[0].erased[0]
    assert first.views[0].image is last.views[0].image


@pytest.mark.parametrize("crashed", [False, True])
def test_the_next_launch_shows_view_and_tiles(launch: Launch, crashed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    session = launch()
    session.viewport.change(panel=(300, 200))
    session.start()
    session.editor.show_object("object 3")
    finish(session, lambda: session.viewport.sharp)
    instance = session.editor.scene.instance
    finish(session, lambda: session.thumbnails.of_object(instance) is not None)
    frame = session.viewport.frame
    if crashed:
        monkeypatch.setattr(recording, "BEAT", 0.05)
        deliver(session, lambda: len(session.store.pictures()) > 1)
    else:
        session.recording.close()
    session.close()
    again = launch()
    assert again.viewport.frame is None and not again.jobs.busy("view")  # nothing is rendered before it is restored
    again.start()
    assert not again.viewport.sharp
    np.testing.assert_array_equal(again.viewport.frame.image, frame.image)
    assert again.thumbnails.of_object(instance) is not None
    heights = []

    def is_sharp() -> bool:
        heights.append(again.viewport.frame.resolution[1])
        return again.viewport.sharp

    deliver(again, is_sharp)
    assert set(heights) == {200}  # none is coarser than the last launch's
