"""Kills at random moments, a full disk, a folder that takes no file, damaged databases.

By hand for a thousand kills: ``KILLS=1000 python -m pytest -n 0 -m slow tests/viewer/store/test_crashes.py``.
"""

import multiprocessing
import os
import random
import resource
import shutil
import signal
import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, suppress
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from core.models.model import Model
from tests.viewer.driver import finish, fit, keep
from tests.viewer.stand_ins import codes_key, detailed_fit, no_guess, quick_frames, quick_photo, shifted, two_models
from viewer.activities import recording
from viewer.services.backend import Backend
from viewer.services.messages import OK, MessageKind
from viewer.services.worker import Worker
from viewer.session import Session
from viewer.store import store
from viewer.store.store import FILE, Store
from viewer.values import history
from viewer.values.objects import EditableObject

_KILLS = int(os.environ.get("KILLS", "60"))
_LIFE = 0.4  # s until a kill, at most
_KILLS_OF_A_FOLDER = 20

Key = tuple[str, bytes, bytes]  # codes to compare: model, shape, texture


def shown(session: Session) -> set[Key]:
    """All states, and the originals of all objects."""
    states = {codes_key(state.scene.instance) for state, _ in session.editor.history.steps.values()}
    return states | {codes_key(item.original) for item in session.editor.objects.ever_added}


class Person:
    """Edits a session at random."""

    def __init__(self, session: Session, numbers: random.Random) -> None:
        self._session = session
        self._numbers = numbers

    def act(self) -> None:
        """Do something."""
        acts = (self.edit, self.edit, self.edit, self.undo, self.show, self.add, self.remove, self.rename, self.new)
        self._numbers.choice(acts)()

    def edit(self) -> None:
        editor = self._session.editor
        editor.edit(shifted(editor.scene.instance, self._numbers.gauss(0, 1)))

    def undo(self) -> None:
        self._session.editor.undo()

    def show(self) -> None:
        objects = self._session.editor.objects
        self._session.editor.show_object(self._numbers.choice([*objects.own, "object 2", "car 3"]))

    def add(self) -> None:
        instance = shifted(self._session.editor.scene.instance, 0.5)
        self._session.editor.objects.add(EditableObject("made", instance, self._numbers.random() < 0.8, 0.5))

    def remove(self) -> None:
        if names := self._session.editor.objects.own:
            self._session.remove(self._numbers.choice(names))

    def rename(self) -> None:
        if names := self._session.editor.objects.own:
            self._session.rename(self._numbers.choice(names), f"name {self._numbers.randrange(10)}")

    def new(self) -> None:
        earlier = self._session.store.earlier
        if earlier and self._numbers.random() < 0.5:
            self._session.open_earlier(self._numbers.choice(earlier))
        else:
            self._session.new()


def live(models: dict[str, Model], folder: Path, seed: int, said: Connection) -> None:
    """Run a session until killed; tell all that the store has at first, then all that is on screen once it is kept."""
    backend = Backend(models.__getitem__, frames=quick_frames, frame_photo=quick_photo, guess_category=no_guess)
    session = Session(Worker(), backend, seed, folder)
    session.resume()
    stored = shown(session)
    for earlier in session.store.earlier:
        project = session.store.session(earlier.number, session.editor.state)
        stored |= {codes_key(state.scene.instance) for state, _ in project.history.steps.values()}
        stored |= {codes_key(item.original) for item in project.objects}
    said.send((stored, [message.text for message in session.messages.all if message.kind is MessageKind.PROBLEM]))
    person = Person(session, random.Random(seed))
    while True:
        person.act()
        session.tick()
        while not session.recording.is_up_to_date:
            time.sleep(0.0005)
            session.tick()
        said.send((shown(session), session.messages.errors))


def killed_run(models: dict[str, Model], folder: Path, numbers: random.Random) -> Iterator[tuple[set[Key], list[str]]]:
    """Start a session, kill it at a random moment, and yield what it has told."""
    context = multiprocessing.get_context("fork")
    hears, says = context.Pipe(duplex=False)
    run = context.Process(target=live, args=(models, folder, numbers.randrange(10**9), says))
    run.start()
    says.close()
    yield hears.recv()
    until = time.monotonic() + numbers.uniform(0, _LIFE)
    heard = []
    while time.monotonic() < until:
        if hears.poll(max(0.0, until - time.monotonic())):
            heard.append(hears.recv())
    assert run.pid is not None
    os.kill(run.pid, signal.SIGKILL)
    run.join()
    with suppress(EOFError, OSError):
        while True:
            heard.append(hears.recv())
    yield from heard


@pytest.mark.slow  # as many kills as it is told to
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no processes are forked on Windows")
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_nothing_on_screen_is_lost_by_kills(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    monkeypatch.setattr(store, "EARLIER", 10_000)  # nothing is dropped because it is old
    monkeypatch.setattr(store, "SWEPT", 5)
    monkeypatch.setattr(recording, "BEAT", 0.05)
    monkeypatch.setattr(history, "DEPTH", 10_000)
    models = two_models()
    numbers = random.Random(seed)
    trained = {codes_key(model[index]) for model in models.values() for index in model.codes.valid}
    edits = 0
    for kill in range(-(-_KILLS // 3)):
        if kill % _KILLS_OF_A_FOLDER == 0:
            folder = tmp_path / str(kill)
            expected = set[Key]()
        (stored, errors), *reports = killed_run(models, folder, numbers)
        assert not errors and not expected - trained - stored, (kill, len(expected - trained - stored))
        for keys, problems in reports:
            assert problems == []
            expected |= keys
        edits += len(reports)
    print(f"{kill + 1} kills, {edits} acts")
    assert edits > kill


@pytest.fixture
def session(worker: Worker, backend: Backend, tmp_path: Path) -> Session:
    """A session that is kept in ``tmp_path``."""
    return Session(worker, backend, 0, tmp_path)


def test_what_a_full_disk_did_not_take_is_kept_once_there_is_room(
    session: Session, worker: Worker, backend: Backend, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording, "BEAT", 0.5)
    session.editor.show_object("object 2")
    keep(session)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    size = max(path.stat().st_size for path in tmp_path.iterdir())
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size + 8_000, hard))
        numbers = random.Random(0)
        while not session.messages.errors:
            Person(session, numbers).edit()
            finish(session)
        session.new()
        session.editor.show_object("object 4")
        finish(session, lambda: not session.store.is_writing)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    made = session.editor.history
    keep(session)
    session.recording.close()
    again = Session(worker, backend, 0, tmp_path)
    again.resume()
    assert again.editor.history == made
    assert len(again.store.session(again.store.earlier[0].number, made.now).history.steps) > 2


def test_a_folder_that_takes_no_file_is_said_and_work_goes_on(worker: Worker, backend: Backend, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    session = Session(worker, backend, 0, tmp_path / "file" / "config")
    session.resume()
    session.editor.show_object("object 2")
    keep(session)
    (message,) = session.messages.all
    assert message.text.startswith("Nothing is kept for the next launch,")
    assert session.save_project(tmp_path / "a.codenerf") and session.messages.errors == []


def _damage_pages(path: Path) -> None:
    content = bytearray(path.read_bytes())
    for page in random.Random(1).sample(range(12, len(content) // 4096), 6):
        content[4096 * page : 4096 * page + 64] = bytes(64)
    path.write_bytes(content)


HARMS = {"text": lambda path: path.write_text("broken" * 1000), "pages": _damage_pages}


@pytest.mark.parametrize("harm", HARMS)
def test_a_damaged_database_is_set_aside_and_what_can_be_read_goes_on(
    session: Session, worker: Worker, backend: Backend, photo: Path, tmp_path: Path, harm: str
) -> None:
    session.jobs.backend = Backend(**(vars(backend) | {"fit": detailed_fit}))
    for _ in range(3):
        fit(session, photo)
    session.recording.close()
    with closing(sqlite3.connect(tmp_path / FILE)) as connection:
        connection.execute("UPDATE sessions SET status = 'open'")  # it crashed
        connection.commit()
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    shutil.copy(tmp_path / FILE, tmp_path / "intact")
    HARMS[harm](tmp_path / FILE)
    damaged = (tmp_path / FILE).read_bytes()
    again = Session(worker, backend, 0, tmp_path)
    again.resume()
    again.tick()
    assert "was damaged" in again.messages.all[0].text and again.messages.all[0].buttons == OK
    assert again.messages.errors == []
    assert (tmp_path / "work damaged.codenerf").read_bytes() == damaged
    assert bool(again.editor.objects.own) == (harm == "pages")
    again.editor.show_object("object 3")
    keep(again)
    again.recording.close()
    assert Store(tmp_path).resume() is not None


@pytest.mark.slow  # a minute
def test_ten_thousand_edits_are_small(session: Session, tmp_path: Path) -> None:
    person = Person(session, random.Random(0))
    for _ in range(10_000):
        person.edit()
        session.tick()
    keep(session)
    session.recording.close()
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) < 30_000_000
