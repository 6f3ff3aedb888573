"""The database of kept work, and the thread that reads and writes it, so that the window never waits."""

import sqlite3
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import NamedTuple, TypeVar

from viewer.store.blobs import Blobs
from viewer.store.encoding import Decoder
from viewer.store.files import save_project
from viewer.store.photo_copies import PhotoCopies
from viewer.store.pictures import Pixels, read_pictures, write_pictures
from viewer.store.rows import SessionReader, SessionRows
from viewer.store.schema import connect, connect_sound, recovered, transaction
from viewer.values.fit_history import FitHistory
from viewer.values.objects import EditableObject
from viewer.values.project import SUFFIX, Project
from viewer.values.state import State

T = TypeVar("T")

FILE = f"work{SUFFIX}"
SILENCE = 30.0  # s without a sign of life after which a window on another display has crashed
EARLIER = 10  # replaced sessions that are kept
SWEPT = 2000  # changes of rows after which contents that nothing needs are deleted
CRASHED = "The program crashed twice with the last session. File, Recent opens it"


class Earlier(NamedTuple):
    """A session that was replaced or left aside."""

    number: int
    changed: float  # s since 1970
    newest: str | None = None  # name of the newest added object

    @property
    def name(self) -> str:
        """The newest added object, if any, and the time of the last change."""
        return f"{self.newest or 'Session'}, {datetime.fromtimestamp(self.changed):%Y-%m-%d %H.%M.%S}"


class Store:
    """Kept work of a user. Writes are queued; reads wait for them, except that of a fit."""

    def __init__(self, folder: Path | None = None, display: str = "", clock: Callable[[], float] = time.time) -> None:
        """Open the database in a folder; None keeps everything in memory.

        Args:
            display: name of this window's display, which has one window: its other sessions have ended.
            clock: s since 1970.
        """
        self.notes: list[str] = []  # remarks on the database for a person
        self.errors: list[Exception] = []  # of writes that failed
        self.copies = PhotoCopies()
        self.earlier: tuple[Earlier, ...] = ()  # the newest first
        self._display = display
        self._clock = clock
        self._queued = 0  # writes that are not finished
        self._swept = 0  # changes of rows until contents were swept
        self._replaced: list[tuple[SessionRows, Project]] = []  # sessions that are not written as earlier ones yet
        self._thread = ThreadPoolExecutor(1, "store")
        self._connection = self._run(lambda: self._open(folder))
        self._blobs = Blobs(self._connection)
        self._rows = SessionRows(self._connection, self._blobs, display, clock)
        self._run(self._list_earlier)

    @property
    def is_writing(self) -> bool:
        """True until all queued writes are finished."""
        return self._queued > 0

    def _run(self, action: Callable[[], T]) -> T:
        """Do something on the thread after all that is queued, and wait for it."""
        return self._thread.submit(action).result()

    def _queue(self, write: Callable[[], None]) -> None:
        """Write on the thread; an error is noted."""

        def run() -> None:
            try:
                write()
            except Exception as error:
                self.errors.append(OSError(str(error)) if isinstance(error, sqlite3.Error) else error)
            finally:
                self._queued -= 1

        self._queued += 1
        self._thread.submit(run)

    def _open(self, folder: Path | None) -> sqlite3.Connection:
        if folder is None:
            return connect(None)
        path = folder / FILE
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if connection := connect_sound(path):
                return connection
            aside = recovered(path).name
            self.notes.append(f"{FILE} was damaged: what could be read of it is here, and the file is kept as {aside}")
            return connect(path)
        except (OSError, ValueError, sqlite3.Error) as error:
            self.notes.append(f"Nothing is kept for the next launch, as {folder} takes no file ({error})")
            return connect(None)

    def _reader(self) -> SessionReader:
        return SessionReader(self._connection, Decoder(self._blobs, self.copies.write))

    # Objects, fits and images

    def mine(self) -> tuple[tuple[EditableObject, ...], dict[str, str]]:
        """Return the fitted objects of all sessions, and the files of models by fingerprint."""
        return self._run(lambda: (tuple(self._reader().objects("mine")), self._reader().model_files()))

    def know(self, objects: tuple[EditableObject, ...]) -> None:
        """Take note of objects of *Mine* as they stand in the library."""
        self._run(lambda: self._rows.know(objects))

    def fit(self, key: str) -> Future[FitHistory]:
        """Return how an object was fitted; an empty history if that is not known."""

        def read() -> FitHistory:
            query = "SELECT fit FROM objects WHERE key = ? AND fit NOT NULL"
            with suppress(ValueError, KeyError, sqlite3.Error):  # a damaged row
                if row := self._connection.execute(query, (int(key),)).fetchone():
                    return self._reader().fit(row[0])
            return FitHistory()

        return self._thread.submit(read)

    def pictures(self) -> dict[str, Pixels]:
        """Return the last images by name."""
        return self._run(lambda: read_pictures(self._connection))

    def keep_pictures(self, make: Callable[[], Mapping[str, Pixels]]) -> None:
        """Store images for the next launch; ``make`` is called on the thread."""
        self._queue(lambda: write_pictures(self._connection, make()))

    # Sessions

    def resume(self) -> int | None:
        """Own the newest session that no window has, and return its number; None if there is none.

        The others become earlier ones, and so does a session that crashed the program twice, which is noted.
        """
        return self._run(self._claim)

    def _claim(self) -> int | None:
        condition = "status = 'closed' OR status = 'open' AND (display = ? OR seen < ?)"
        query = f"SELECT id, status, crashes FROM sessions WHERE {condition} ORDER BY changed DESC, id DESC"
        try:
            with transaction(self._connection):
                left = self._connection.execute(query, (self._display, self._clock() - SILENCE)).fetchall()
                numbers = [row[:1] for row in left]
                self._connection.executemany("UPDATE sessions SET status = 'earlier' WHERE id = ?", numbers)
                number, status, crashes = left[0] if left else (None, "", 0)
                crashes = crashes + 1 if status == "open" else 0
                if number is not None and crashes < 2:
                    self._rows.claim(number, crashes)
            self._list_earlier()
        except sqlite3.Error as error:
            self.notes.append(f"The last session could not be opened ({error})")
            return None
        if crashes >= 2:
            self.notes.append(CRASHED)
            return None
        return number

    def _list_earlier(self) -> None:
        """List the earlier sessions, and delete the oldest ones beyond the limit."""
        newest = "SELECT name FROM objects JOIN members ON object = key WHERE session = sessions.id ORDER BY key DESC"
        query = f"SELECT id, changed, ({newest}) FROM sessions WHERE status = 'earlier' ORDER BY changed DESC, id DESC"
        sessions = [Earlier(*row) for row in self._connection.execute(query)]
        self._delete(session.number for session in sessions[EARLIER:])
        self.earlier = tuple(sessions[:EARLIER])

    def session(self, number: int, current_state: State) -> Project:
        """Return a session as a project; with the state ``current_state`` alone if none can be read."""
        return self._run(lambda: self._reader().session(number, current_state))

    def write(self, project: Project) -> None:
        """Write the changes of this window's session."""
        self._queue(lambda: self._rows.write(project))

    def archive(self, project: Project) -> None:
        """Make this window's session an earlier one, unless it is empty, and begin another one."""

        def write() -> None:
            self._replaced.append((self._rows, project))
            self._rows = SessionRows(self._connection, self._blobs, self._display, self._clock)
            self._write_replaced()

        self._queue(write)

    def _write_replaced(self) -> None:
        """Write replaced sessions, also those that the disk had no room for when they were replaced."""
        while self._replaced:
            self._end(*self._replaced[0], "earlier")
            del self._replaced[0]
            self._list_earlier()

    def _end(self, rows: SessionRows, project: Project, status: str) -> None:
        """Write a session for the last time; delete it if it is empty."""
        if project.is_empty:
            self._delete([rows.number] if rows.number is not None else ())
        else:
            rows.write(project, status)

    def _delete(self, numbers: Iterable[int]) -> None:
        with transaction(self._connection):
            self._connection.executemany("DELETE FROM sessions WHERE id = ?", ((number,) for number in numbers))

    def save(self, project: Project, path: Path) -> None:
        """Save a project as a file for any machine. Raises ``ValueError`` or ``sqlite3.Error`` on failure."""

        def save() -> None:
            self._rows.write(project)
            assert self._rows.number is not None
            save_project(self._connection, self._rows.number, path)

        self._run(save)

    def beat(self) -> None:
        """Tell other windows that this one is alive, and make sure that its work survives a loss of power."""

        def beat() -> None:
            self._rows.beat()
            self._write_replaced()
            if self._connection.total_changes > self._swept + SWEPT:
                self._sweep()
            self._connection.execute("PRAGMA wal_checkpoint(PASSIVE)")

        self._queue(beat)

    def _sweep(self) -> None:
        with transaction(self._connection):
            self._blobs.sweep()
        self._swept = self._connection.total_changes

    def close(self, project: Project) -> None:
        """Write the session for the next launch and end the thread."""

        def close() -> None:
            try:
                self._write_replaced()
                self._end(self._rows, project, "closed")
                self._sweep()
            finally:
                self._connection.close()

        self._queue(close)
        self._thread.shutdown()
