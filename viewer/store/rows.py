"""Rows of sessions and objects: written as far as they have changed, and read by the types of their columns."""

import secrets
import sqlite3
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from core.models.model import Instance
from core.runtime.numbers import whole
from core.runtime.reading import first_line, typed
from viewer.store.blobs import Blobs
from viewer.store.encoding import Decoder, put
from viewer.store.schema import transaction
from viewer.values.fit_history import FitHistory, FitRequest
from viewer.values.history import History, Step
from viewer.values.objects import EditableObject, unique_name
from viewer.values.project import Project
from viewer.values.state import State

_MAX_STEPS = 32  # steps of a finished fit that are kept, for its curve
_MAX_ROWS = 10_000  # of a kind that are read of a session
_NOTHING = Project(History({}))


class Pending(NamedTuple):
    """Requests for fits that are not finished."""

    requests: tuple[FitRequest, ...]


class SessionRows:
    """The rows of one session, which a window owns."""

    def __init__(self, connection: sqlite3.Connection, blobs: Blobs, display: str, clock: Callable[[], float]) -> None:
        """Begin a session, which has rows once it is written."""
        self.number: int | None = None
        self._connection = connection
        self._blobs = blobs
        self._display = display
        self._clock = clock
        self._owner = secrets.token_hex(8)
        self._known: dict[str, tuple[EditableObject, bool]] = {}  # objects as their rows have them, and as *Mine*
        self._written = _NOTHING  # as the rows have it

    def know(self, objects: Iterable[EditableObject]) -> None:
        """Take note of objects of *Mine* that were read, and need not be written."""
        self._known |= {item.key: (item, True) for item in objects}

    def claim(self, number: int, crashes: int) -> None:
        """Own a session that another run has left; inside a transaction."""
        self.number = number
        values = self._owner, self._display, self._clock(), crashes, number
        self._connection.execute(
            "UPDATE sessions SET status = 'open', owner = ?, display = ?, seen = ?, crashes = ? WHERE id = ?", values
        )

    def write(self, project: Project, status: str = "open") -> None:
        """Write changes since the last call, in one transaction. Raises ``sqlite3.Error`` on failure."""
        try:
            self._write(project, status)
        except sqlite3.IntegrityError:  # another window has deleted something that this one still has
            stored = {str(key) for (key,) in self._connection.execute("SELECT key FROM objects")}
            self._known = {key: row for key, row in self._known.items() if key in stored}
            self._write(project, status)
        self._written = project
        self._known = {item.key: (item, _is_mine(item, project)) for item in project.objects}

    def _write(self, project: Project, status: str) -> None:
        try:
            with transaction(self._connection):
                self._write_session(project, status)
        except sqlite3.Error:
            self._blobs.numbers.clear()  # of rows that were rolled back, whose numbers others will have
            raise

    def _write_session(self, project: Project, status: str) -> None:
        now = self._clock()
        if not self.beat():
            self.number = None  # another window has gone on with it while this one slept
            self._written = _NOTHING
            values = status, self._display, self._owner, now, now
            inserted = self._connection.execute(
                "INSERT INTO sessions (status, display, owner, seen, changed) VALUES (?, ?, ?, ?, ?)", values
            )
            self.number = inserted.lastrowid
        self._write_objects(project)
        self._write_steps(project)
        requests = tuple(request._replace(history=_thinned(request.history)) for request in project.pending)
        pending = put(self._blobs, Pending(requests)) if requests else None
        path = str(project.path) if project.path else None
        assignments = "status = ?, changed = ?, current = ?, tip = ?, pending = ?, project = ?"
        row = status, now, project.history.current, project.history.tip, pending, path, self.number
        self._connection.execute(f"UPDATE sessions SET {assignments} WHERE id = ?", row)

    def beat(self) -> bool:
        """Tell other windows that this one is alive; False if the session is not this window's, or has no rows."""
        query = "UPDATE sessions SET seen = ? WHERE id = ? AND owner = ?"
        return bool(self._connection.execute(query, (self._clock(), self.number, self._owner)).rowcount)

    def _write_objects(self, project: Project) -> None:
        execute = self._connection.execute
        for entry in project.model_files.items() - self._written.model_files.items():
            execute("INSERT OR REPLACE INTO models VALUES (?, ?)", entry)
        for item in project.objects:
            stored, was_mine = self._known.get(item.key, (None, None))
            is_mine = _is_mine(item, project)
            if stored is not item or was_mine is not is_mine:
                self._write_object(item, is_mine)
        for key, fit in project.fits.items():
            if self._written.fits.get(key) is not fit and fit.sources:
                execute("UPDATE objects SET fit = ? WHERE key = ?", (put(self._blobs, _thinned(fit)), int(key)))
        if not self._written.history.steps:
            execute("DELETE FROM members WHERE session = ?", (self.number,))
            execute("DELETE FROM steps WHERE session = ?", (self.number,))
        old_keys, new_keys = ({int(item.key) for item in value.members} for value in (self._written, project))
        for member in new_keys - old_keys:
            execute("INSERT OR IGNORE INTO members VALUES (?, ?)", (self.number, member))
        for member in old_keys - new_keys:
            execute("DELETE FROM members WHERE session = ? AND object = ?", (self.number, member))

    def _write_object(self, item: EditableObject, is_mine: bool) -> None:
        ends = (put(self._blobs, item.instance), item.unedited and put(self._blobs, item.unedited))
        root = int(item.version_of) if item.version_of else None
        values = int(item.key), item.name, root, item.fitted, item.confidence, *ends, is_mine
        columns = "key", "name", "version_of", "fitted", "confidence", "codes", "unedited", "mine"
        changes = ", ".join(f"{column} = excluded.{column}" for column in columns[1:])
        insertion = f"INSERT INTO objects ({', '.join(columns)}) VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
        self._connection.execute(f"{insertion} ON CONFLICT (key) DO UPDATE SET {changes}", values)

    def _write_steps(self, project: Project) -> None:
        """Write the steps that differ, objects in them by their keys, as other sessions may rename them."""
        keys = {item.name: f"#{item.key}" for item in project.objects}
        written = self._written.history.steps
        steps = project.history.steps
        gone = [(self.number, number) for number in written.keys() - steps.keys()]
        rows = [
            (self.number, number, step.parent, put(self._blobs, step.state.renamed(keys)))
            for number, step in steps.items()
            if written.get(number) != step
        ]
        self._connection.executemany("DELETE FROM steps WHERE session = ? AND number = ?", gone)
        self._connection.executemany("INSERT OR REPLACE INTO steps VALUES (?, ?, ?, ?)", rows)


def _is_mine(item: EditableObject, project: Project) -> bool:
    """Return whether an object is one of *Mine*: fitted, and not removed."""
    return item.fitted and item.name not in project.history.now.removed


def _thinned(fit: FitHistory) -> FitHistory:
    """Return a fit with few steps, of which only the last has its own object, and hypotheses."""
    *earlier, last = fit.steps or (None,)
    if last is None:
        return fit
    stride = -(-len(earlier) // (_MAX_STEPS - 1)) or 1
    steps = (replace(step, instance=last.instance, hypotheses=()) for step in earlier[::stride])
    return replace(fit, steps=(*steps, last))


# Reading


class _Object(NamedTuple):
    """Columns of an object; ``codes``, ``unedited`` and ``fit`` are numbers of contents."""

    key: int
    name: str
    version_of: int | None
    fitted: int
    confidence: float | None
    codes: int
    unedited: int | None
    fit: int | None


class SessionReader:
    """Reads rows without those that are damaged, for which it has the reasons."""

    def __init__(self, connection: sqlite3.Connection, decoder: Decoder) -> None:
        self._connection = connection
        self._decoder = decoder
        self.lost: list[str] = []

    def objects(self, where: str, *values: Any) -> dict[EditableObject, int | None]:
        """Return objects, the oldest first, with the numbers of their fits. Equal names get a number."""
        columns = ", ".join(_Object._fields)
        rows = self._rows(f"SELECT {columns} FROM objects WHERE {where} ORDER BY key LIMIT {_MAX_ROWS}", *values)
        objects = dict[EditableObject, int | None]()
        taken = set[str]()
        for row in rows:
            if (entry := self._try(partial(self._object, row, taken))) is not None:
                objects[entry[0]] = entry[1]
                taken.add(entry[0].name)
        return objects

    def _object(self, row: tuple, taken: set[str]) -> tuple[EditableObject, int | None]:
        columns = typed(_Object, dict(zip(_Object._fields, row, strict=True)), name="object")
        instance = self._decoder.value(Instance, columns.codes)
        unedited = None if columns.unedited is None else self._decoder.value(Instance, columns.unedited)
        root = "" if columns.version_of is None else str(columns.version_of)
        name = unique_name(columns.name, taken)
        values = bool(columns.fitted), columns.confidence, unedited, root, str(columns.key)
        return EditableObject(name, instance, *values), columns.fit

    def session(self, number: int, current_state: State | None, with_fits: bool = False) -> Project:
        """Return a session as a project; with the state ``current_state`` alone if none can be read."""
        rows = self._rows("SELECT current, tip, pending, project FROM sessions WHERE id = ?", number)
        current, tip, pending, path = rows[0] if rows else (None,) * 4
        where = f"key IN (SELECT object FROM members WHERE session = ? LIMIT {_MAX_ROWS})"
        objects = self.objects(where, number)
        names = {f"#{item.key}": item.name for item in objects}
        fits = {
            item.key: fit
            for item, content in objects.items()
            if with_fits and content is not None and (fit := self._try(partial(self.fit, content)))
        }
        return Project(
            self._history(number, current, tip, names, current_state),
            tuple(objects),
            fits,
            (self._try(partial(self._pending, pending)) or ()) if pending is not None else (),
            self.model_files(),
            self._try(lambda: typed(Path | None, path, name="project")),
            lost=tuple(dict.fromkeys(self.lost)),
        )

    def model_files(self) -> dict[str, str]:
        """Return names or paths of models by fingerprint."""
        rows = self._rows(f"SELECT fingerprint, file FROM models LIMIT {_MAX_ROWS}")
        return {key: file for key, file in rows if isinstance(key, str) and isinstance(file, str)}

    def fit(self, content: int) -> FitHistory:
        """Return how an object was fitted. Raises ``ValueError`` for other content."""
        return _checked(self._decoder.value(FitHistory, content))

    def _pending(self, content: Any) -> tuple[FitRequest, ...]:
        requests = self._decoder.value(Pending, content).requests
        for request in requests:
            _checked(request.history)
        return requests

    def _history(
        self, number: int, current: Any, tip: Any, names: dict[str, str], current_state: State | None
    ) -> History:
        """Return a history without unreadable states; readable ones are consecutive if they are no tree."""
        query = f"SELECT number, parent, state FROM steps WHERE session = ? ORDER BY number LIMIT {_MAX_ROWS}"
        rows = self._rows(query, number)
        states = {step: self._try(partial(self._decoder.value, State, content)) for step, _, content in rows}
        unreadable = {step for step, state in states.items() if state is None}
        readable = [state.renamed(names) for state in states.values() if state]
        if not readable:
            if current_state is None:
                raise ValueError(*self.lost[:1])
            return History.of(current_state)

        def tree() -> History:
            renamed = {step: state.renamed(names) if state else readable[0] for step, state in states.items()}
            steps = {whole(step): Step(renamed[step], whole(parent)) for step, parent, _ in rows}
            history = History(steps, whole(current), whole(tip))
            history.check()
            return history.without(unreadable)

        return self._try(tree) or History.of(*readable)

    def _rows(self, query: str, *values: Any) -> list[tuple]:
        """Return the rows of a query, up to the first damaged one."""
        rows = list[tuple]()
        self._try(lambda: rows.extend(self._connection.execute(query, values)))
        return rows

    def _try(self, read: Callable[[], Any]) -> Any:
        """Return the value of ``read``; None if it raises, for a reason that is noted."""
        try:
            return read()
        except Exception as error:
            self.lost.append(first_line(error))
            return None


def _checked(fit: FitHistory) -> FitHistory:
    """Return a fit. Raises ``ValueError`` if its cameras differ in image size from its photos."""
    sizes = {fitted.pixels.shape[1::-1] for fitted in fit.photos}
    for step in fit.steps:
        for result in (step, *step.hypotheses, step.runner_up):
            if result and not {(camera.width, camera.height) for camera in result.cameras} <= sizes:
                raise ValueError("the cameras have another size than the photos")
    return fit
