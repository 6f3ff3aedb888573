import os
import random
import subprocess
import sys
import threading
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from filelock import FileLock
from PIL import Image, ImageOps

from core.detail.progressive import Frame
from core.models.open_models import OpenModels
from core.models.photo_detail import Erasure, PhotoDetail, PhotoView
from tests.conftest import random_model
from tests.viewer.driver import deliver, finish
from tests.viewer.stand_ins import Clock, detailed_fit, endless_fit
from viewer import autosave as autosave_module
from viewer.autosave import Autosave
from viewer.editor import Editor
from viewer.services.backend import Backend
from viewer.services.worker import Worker
from viewer.session import Session
from viewer.values.history import History
from viewer.values.objects import EditableObject
from viewer.values.project import Project

Launch = Callable[..., tuple[Session, Autosave]]
Kill = Callable[[Autosave], None]


def edit(session: Session, photo: Path) -> None:
    """A fitted object, a mix, another object."""
    editor = session.editor
    session.fitting.start(photo)
    finish(session, lambda: not session.fitting.running)
    editor.set_b("object 4")
    editor.mix_both(0.0, 0.4)
    editor.show_object("object 2")
    editor.end_gesture()


@pytest.fixture
def launch(worker: Worker, backend: Backend, tmp_path: Path, clock: Clock) -> Launch:
    """Opens a session that keeps itself in ``tmp_path``."""

    def begin(backend: Backend = backend, folder: Path = tmp_path) -> tuple[Session, Autosave]:
        session = Session(worker, backend, 1, folder)
        return session, Autosave(session, folder, clock)

    return begin


@pytest.fixture
def kill(tmp_path: Path, clock: Clock) -> Kill:
    """Saves a session, and makes its file that of a run that has ended."""

    def end(autosave: Autosave) -> None:
        clock.now += 10.0
        autosave.tick()
        autosave.finish()
        (written,) = (path for path in tmp_path.glob("*.codenerf") if path.stem.startswith(("running", "again")))
        written.rename(written.with_stem(f"{written.stem.split('-')[0]}-999999999"))

    return end


def test_the_session_is_saved_between_drags(session: Session, editor: Editor, tmp_path: Path, clock: Clock) -> None:
    autosave = Autosave(session, tmp_path, clock)
    clock.now = 10.0
    autosave.tick()
    autosave.finish()
    assert not list(tmp_path.glob("*.codenerf"))  # nothing was made yet
    clock.now = 20.0
    editor.mix_both(0.5, 0.4, gesture="mix pad")
    autosave.tick()
    autosave.finish()
    assert not list(tmp_path.glob("*.codenerf"))
    editor.end_gesture()
    autosave.tick()
    autosave.finish()
    (written,) = tmp_path.glob("*.codenerf")
    before = written.read_bytes()
    editor.show_object("object 2")
    autosave.tick()
    autosave.finish()
    assert written.read_bytes() == before  # too early
    clock.now = 30.0
    autosave.tick()
    autosave.finish()
    assert written.read_bytes() != before
    autosave.close()
    (ended,) = tmp_path.glob("*.codenerf")
    assert ended.stem.startswith("session-")


def test_the_next_launch_goes_on_with_objects_of_every_model(launch: Launch, photo: Path, both: Backend) -> None:
    session, autosave = launch(both)
    edit(session, photo)
    session.editor.show_object("car 2")
    made = session.editor.history
    steps = session.fitting.history.steps
    step = session.fitting.history.last
    autosave.close()
    session, autosave = launch(both)
    assert session.editor.history == made
    assert session.editor.model.category == "cars"
    assert [step.psnr for step in session.fitting.history.steps] == [step.psnr for step in steps]
    assert session.fitting.history.last.runner_up == step.runner_up
    assert session.fitting.history.last.confidence == step.confidence
    assert session.fitting.history.photo is not None


def test_a_fit_under_way_and_those_that_wait_go_on(launch: Launch, backend: Backend, photo: Path) -> None:
    second = photo.with_name("block other.png")
    second.write_bytes(photo.read_bytes())
    session, autosave = launch(replace(backend, fit=endless_fit))
    session.fitting.start(photo)
    session.fitting.start(second)
    deliver(session, lambda: len(session.fitting.history.steps) > 3)
    autosave.close()
    photo.unlink()  # it was read already
    session, autosave = launch()
    assert session.fitting.running
    assert len(session.fitting.queue) == 1
    finish(session, lambda: not session.fitting.pending)
    assert session.messages.errors == []
    assert session.editor.objects.own[:2] == ["block other", "block"]


_RUN = """
import sys
from dataclasses import replace
from pathlib import Path

from tests.viewer.driver import deliver
from tests.viewer.stand_ins import endless_fit, no_guess, quick_frames, quick_photo, two_models
from viewer import autosave as autosave_module
from viewer.services.backend import Backend
from viewer.services.worker import Worker
from viewer.session import Session

folder, photo = map(Path, sys.argv[1:3])
backend = Backend(two_models().__getitem__, frame_photo=quick_photo, frames=quick_frames, fit=endless_fit)
backend = replace(backend, guess_category=no_guess)
session = Session(Worker(), backend)
autosave_module.EVERY = 0.0
autosave = autosave_module.Autosave(session, folder)
session.editor.show_object("car 2")
session.editor.show_object("object 1")
session.fitting.start(photo)
deliver(session, lambda: len(session.fitting.history.steps) > 3)
while True:  # written again and again, so that it is killed in the middle of that
    session.editor.show_object("object 3")
    session.editor.show_object("object 2")
    session.tick()
    autosave.tick()
    autosave.finish()
    print("written", flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no signals on Windows")
def test_a_program_killed_in_mid_fit_has_lost_nothing_of_either_model(
    launch: Launch, tmp_path: Path, photo: Path, kill: Kill, both: Backend
) -> None:
    folder = tmp_path / "config"
    folder.mkdir()
    command = [sys.executable, "-c", _RUN, str(folder), str(photo)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=Path(__file__).parents[2]) as run:
        for _ in range(5):
            assert run.stdout.readline() == b"written\n"
        run.kill()
    session, _ = launch(both, folder)
    assert session.messages.errors == []
    assert len(session.editor.history.past) >= 3
    assert session.fitting.running
    finish(session, lambda: not session.fitting.running)
    assert session.editor.objects.own[0] == "block"
    assert session.editor.history.states[1].mix.a.shape == "car 2"


def test_a_session_that_ended_the_program_twice_is_not_opened(launch: Launch, kill: Kill) -> None:
    session, autosave = launch()
    session.editor.show_object("object 2")
    kill(autosave)
    session, autosave = launch()
    assert session.editor.history.past
    session.editor.show_object("object 3")
    kill(autosave)
    session, autosave = launch()
    assert not session.editor.history.past
    assert "ended twice" in session.messages.shown[-1].text
    (earlier,) = autosave.earlier
    assert len(Project.load(earlier, session.models).history.past) == 2
    session.editor.show_object("object 3")
    autosave.close()
    session, autosave = launch()
    assert session.editor.history.past


def test_a_session_that_ends_the_program_is_not_begun_with_again(launch: Launch, tmp_path: Path) -> None:
    session, autosave = launch()
    session.editor.show_object("object 2")
    autosave.close()
    launch()
    (path,) = tmp_path.glob("*.codenerf")
    assert path.stem.startswith("running-")  # that of the run that loaded it


def test_the_place_of_the_project_is_known_at_the_next_launch(launch: Launch, tmp_path: Path) -> None:
    session, autosave = launch()
    session.editor.show_object("object 2")
    session.save_project(tmp_path / "a.codenerf")
    assert Project.load(tmp_path / "a.codenerf", session.models).path is None  # which may be given to others
    autosave.close()
    again, _ = launch()
    assert again.project_path == tmp_path / "a.codenerf"


def test_of_two_windows_neither_session_is_lost(launch: Launch, tmp_path: Path) -> None:
    first, of_first = launch()
    second, of_second = launch()
    first.editor.show_object("object 2")
    second.editor.show_object("object 3")
    of_first.close()
    of_second.close()
    assert len(list(tmp_path.glob("session-*.codenerf"))) == 2


def test_new_archives_the_session_and_keeps_fitted_objects(launch: Launch, photo: Path) -> None:
    session, autosave = launch()
    edit(session, photo)
    history = session.editor.history
    session.new()
    editor = session.editor
    assert not editor.history.past
    assert editor.objects.own[0] == "block"  # it is mine
    (earlier,) = autosave.earlier
    session.new()
    assert len(autosave.earlier) == 1  # nothing had been made
    session.open_project(earlier)
    assert session.editor.history == history
    assert session.editor.objects.own.count("block") == 1
    session.new()
    autosave.close()
    session, autosave = launch()
    assert not session.editor.history.past


def test_states_of_a_replaced_model_wait_for_it(launch: Launch, backend: Backend) -> None:
    session, autosave = launch()
    session.editor.show_object("object 2")
    made = session.editor.history
    autosave.close()
    session, autosave = launch(replace(backend, load_model=lambda name: random_model(9)))
    editor = session.editor
    assert editor.history.past == made.states and editor.can_show(editor.state)
    assert "waits in Mine" in session.messages.shown[-1].text
    editor.undo()
    assert editor.can_show(editor.state)
    autosave.close()
    session, _ = launch()
    assert session.editor.state == made.now


def test_a_kept_session_that_is_broken_is_reported_and_stays(launch: Launch, tmp_path: Path) -> None:
    (tmp_path / "session.codenerf").write_text("broken")
    session, autosave = launch()
    assert len(session.messages.errors) == 1
    assert [path.read_text() for path in autosave.earlier] == ["broken"]


def test_of_several_sessions_the_newest_goes_on_unless_it_runs(launch: Launch, tmp_path: Path) -> None:
    for age, name in enumerate(("object 2", "object 3", "object 4")):
        (tmp_path / name).mkdir()
        session, autosave = launch(folder=tmp_path / name)
        session.editor.show_object(name)
        autosave.close()
        (ended,) = (tmp_path / name).glob("*.codenerf")
        os.utime(ended.rename(tmp_path / f"running-{age}.codenerf"), (age, age))
    with FileLock(tmp_path / ".running-2.lock"):
        session, autosave = launch()
    assert session.editor.state.mix.a.shape == "object 3"
    (earlier,) = autosave.earlier
    assert Project.load(earlier, session.models).history.now.mix.a.shape == "object 2"
    assert (tmp_path / "running-2.codenerf").exists()


@pytest.mark.parametrize("harm", ["{", "no tensors"])
def test_an_unreadable_session_changes_nothing(session: Session, editor: Editor, tmp_path: Path, harm: str) -> None:
    editor.show_object("object 3")
    path = tmp_path / "running-999999999.codenerf"
    session.project().save(path, session.models)
    with zipfile.ZipFile(path) as file:
        members = {name: file.read(name) for name in file.namelist()}
    if harm == "no tensors":
        del members["tensors.safetensors"]
    else:
        members["project.json"] = harm.encode()
    with zipfile.ZipFile(path, "w") as file:
        for name, content in members.items():
            file.writestr(name, content)
    before = editor.history
    autosave = Autosave(session, tmp_path)
    finish(session)
    assert session.editor.history is before
    assert len(session.messages.errors) == 1
    assert len(autosave.earlier) == 1


def test_the_window_does_not_wait_for_a_save(
    session: Session, editor: Editor, tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    autosave = Autosave(session, tmp_path, clock)
    may_write = threading.Event()
    save = Project.save
    threads = list[threading.Thread]()

    def slow(project: Project, path: Path, models: OpenModels) -> None:
        threads.append(threading.current_thread())
        assert may_write.wait(60)
        save(project, path, models)

    monkeypatch.setattr(Project, "save", slow)
    for name in ("object 2", "object 3"):
        clock.now += 10.0
        editor.show_object(name)
        autosave.tick()  # the second time, the first file is still being written
    may_write.set()
    autosave.finish()
    (path,) = tmp_path.glob("*.codenerf")
    assert len(Project.load(path, session.models).history.past) == 1
    autosave.tick()
    autosave.finish()
    assert len(Project.load(path, session.models).history.past) == 2
    assert len(threads) == 2
    assert threading.main_thread() not in threads


def test_undo_after_many_strokes_is_small(session: Session, editor: Editor, tmp_path: Path) -> None:
    """Each state holds all strokes that were drawn before it; the file has each stroke once."""
    instance = editor.scene.instance
    view = PhotoView.of(np.full((32, 32, 4), 255, np.uint8), editor.scene.camera.resized(32, 32))
    detail = PhotoDetail((view,), instance.codes.shape, instance.codes.texture)
    states = [replace(editor.state, scene=replace(editor.scene, instance=instance.with_detail(detail)))]
    numbers = random.Random(0)
    for step in range(500):
        if step % 5 == 0:
            points = tuple((numbers.random(), numbers.random()) for _ in range(40))
            detail = detail.erasing(0, (*detail.views[0].erased, Erasure(points, 0.04)))
        state = replace(editor.state, mix=editor.state.mix.with_amount("texture", step / 500))
        states.append(replace(state, scene=replace(editor.scene, instance=instance.with_detail(detail))))
    editor.show_object("object 2")
    saved = session.project()
    saved = replace(saved, history=History.of(*states))
    saved.save(tmp_path / "a.codenerf", session.models)
    with zipfile.ZipFile(tmp_path / "a.codenerf") as file:
        assert file.getinfo("project.json").file_size < 1_000_000
    loaded = Project.load(tmp_path / "a.codenerf", session.models)
    assert loaded.history == saved.history
    first, last = (loaded.history.states[index].scene.instance.detail for index in (-10, -1))
    assert first.views[0].erased[0] is last.views[0].erased[0]


@pytest.mark.parametrize("crashed", [False, True])
def test_the_next_launch_shows_the_view_and_tiles_at_once(launch: Launch, kill: Kill, crashed: bool) -> None:
    session, autosave = launch()
    session.start()
    session.editor.show_object("object 3")
    finish(session, lambda: session.viewport.sharp)
    instance = session.editor.scene.instance
    camera = session.editor.scene.camera.resized(64, 64)

    def tile(session: Session) -> Frame | None:
        return session.thumbnails.get(instance, camera)

    finish(session, lambda: (thumbnail := tile(session)) is not None and thumbnail.resolution == (64, 64))
    last_frame = session.viewport.frame
    if crashed:
        kill(autosave)
    else:
        autosave.close()
    session.close()
    again, second = launch()
    again.viewport.change(panel=(300, 200))
    assert again.viewport.frame is None and not again.jobs.busy("view")  # nothing is rendered before it is restored
    again.start()
    frame = again.viewport.frame
    assert frame is not None and last_frame is not None and not again.viewport.sharp
    np.testing.assert_array_equal(frame.image, last_frame.image)
    assert crashed or tile(again).resolution == (64, 64)
    second.close()


def test_the_next_launch_shows_no_coarser_image_than_the_last_one(launch: Launch) -> None:
    session, autosave = launch()
    session.viewport.change(panel=(300, 200))
    session.start()
    finish(session, lambda: session.viewport.sharp)
    autosave.close()
    session.close()
    again, second = launch()
    again.start()  # before the window tells how large the view is
    heights = []

    def is_sharp() -> bool:
        heights.append(again.viewport.frame.resolution[1])
        return again.viewport.sharp

    deliver(again, is_sharp)
    assert set(heights) == {200}
    again.editor.show_object("object 3")
    heights.clear()
    deliver(again, is_sharp)
    assert min(heights) < 200
    second.close()


def test_the_next_launch_shows_the_whole_photo_of_every_object(
    launch: Launch, backend: Backend, photo: Path, tmp_path: Path
) -> None:
    session, autosave = launch(replace(backend, fit=detailed_fit))
    sizes = {"block": (96, 96), "block wide": (120, 100)}
    for name, size in sizes.items():
        path = tmp_path / f"{name}.png"
        with Image.open(photo) as image:
            ImageOps.pad(image, size, color="white").save(path)
        session.fitting.start(path)
        finish(session, lambda: not session.fitting.running)
    autosave.close()
    session, second = launch()
    for name, (width, height) in sizes.items():
        session.editor.show_object(session.editor.objects.version(name, session.editor.objects[name].instance))
        assert session.whole_photo.shape == (height, width, 3)
    session.editor.edit(session.editor.scene.instance.changed(texture=session.editor.code("texture") + 0.1))
    assert session.whole_photo.shape == (height, width, 3)  # an edit keeps the photo
    session.editor.show_object("object 3")
    assert session.whole_photo is None
    second.close()


def test_closing_writes_only_what_was_not_written_before(
    launch: Launch, tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    session, autosave = launch()
    session.start()
    session.editor.show_object("object 3")
    finish(session, lambda: session.viewport.sharp)
    for _ in range(2):  # the project with the image of the view, then new tiles
        session.thumbnails.of_object(session.editor.scene.instance)
        finish(session)
        clock.now += autosave_module.EVERY_PICTURES
        autosave.tick()
        autosave.finish()
    made = session.editor.history
    written = list[str]()
    monkeypatch.setattr(Project, "save", lambda *_: written.append("project"))
    monkeypatch.setattr(autosave_module, "write_pictures", lambda *_: written.append("pictures"))
    autosave.close()
    assert written == []
    monkeypatch.undo()
    session, autosave = launch()
    assert session.editor.history == made
    session.start()
    assert session.viewport.frame is not None
    session.editor.show_object("object 4")
    autosave.close()  # at once
    session, _ = launch()
    assert session.editor.state.mix.a.shape == "object 4"


def test_a_save_that_failed_is_repeated_when_closing(
    launch: Launch, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise ValueError("no space left")

    session, autosave = launch()
    session.editor.show_object("object 3")
    monkeypatch.setattr(Project, "save", fail)
    clock.now += 10.0
    autosave.tick()
    autosave.finish()
    monkeypatch.undo()
    autosave.close()
    assert len(session.messages.errors) == 1
    session, _ = launch()
    assert session.editor.state.mix.a.shape == "object 3"


def test_the_last_save_of_a_project_that_cannot_be_archived_is_kept(
    session: Session, editor: Editor, tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    autosave = Autosave(session, tmp_path, clock)
    editor.show_object("object 3")
    clock.now += 10
    autosave.tick()
    autosave.finish()

    def fails(project: Project, path: Path, models: OpenModels) -> None:
        raise OSError("the disk is full")

    with monkeypatch.context() as patched:
        patched.setattr(Project, "save", fails)
        session.new()
    assert "the disk is full" in session.messages.errors[0]
    session.editor.show_object("object 4")
    autosave.close()
    (kept,) = autosave.earlier
    assert Project.load(kept, session.models).history.now.mix.a.shape == "object 3"


def test_an_object_that_was_never_shown_is_archived(session: Session, tmp_path: Path, clock: Clock) -> None:
    autosave = Autosave(session, tmp_path, clock)
    session.editor.objects.add(EditableObject("my chair", session.editor.model[3], fitted=True))
    session.new()
    (kept,) = autosave.earlier
    assert [added.name for added in Project.load(kept, session.models).objects] == ["my chair"]
