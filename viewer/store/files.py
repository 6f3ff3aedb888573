"""Projects: databases with the same tables and one session, which may come from anybody."""

import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from urllib.parse import quote

from core.runtime.files import atomic_file
from core.runtime.reading import MAX_TEXT, reading
from viewer.store.blobs import USED_BY_SESSION, Blobs
from viewer.store.encoding import Decoder
from viewer.store.photo_copies import PhotoCopies
from viewer.store.rows import SessionReader
from viewer.store.schema import APPLICATION, VERSION, connect, copy_readable, is_sound, schema_version, transaction
from viewer.values.project import Project
from viewer.values.state import State

_MAX_FILE = 400_000_000  # bytes of a project
_LONGEST = 20.0  # s that reading a project may take
_STEPS = 10_000  # of SQLite's machine between two looks at the clock
_ALLOWED = {sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ, sqlite3.SQLITE_PRAGMA}


def save_project(connection: sqlite3.Connection, session: int, path: Path) -> None:
    """Copy a session's rows with all that they refer to into a project file, which replaces one that is there.

    Raises ``ValueError`` if it cannot be written or read back; the former file stays.
    """
    with atomic_file(path, _check) as written:
        with closing(connect(written)) as new:
            new.execute("PRAGMA journal_mode = DELETE")  # one file, wherever it goes
        connection.execute("ATTACH ? AS project", (str(written),))
        try:
            _copy(connection, session)
        except sqlite3.Error as error:
            raise ValueError(f"cannot write {path}: {error}") from error
        finally:
            connection.execute("DETACH project")


def _copy(connection: sqlite3.Connection, session: int) -> None:
    members = "key IN (SELECT object FROM members WHERE session = :session)"
    values = "blobs JOIN used USING (id) WHERE typeof(content) = 'text' AND json_valid(content)"
    fingerprints = f"SELECT json_extract(content, '$.model') FROM {values}"
    columns = "id, 'closed', '', '', 0, 0, 0, current, tip, pending, NULL"
    rows = {
        "blobs": f"{USED_BY_SESSION} SELECT blobs.* FROM blobs JOIN used USING (id)",
        "parts": f"{USED_BY_SESSION} SELECT parts.* FROM parts JOIN used ON whole = used.id",
        "models": f"{USED_BY_SESSION} SELECT * FROM models WHERE fingerprint IN ({fingerprints})",
        "objects": f"SELECT * FROM objects WHERE {members}",
        "sessions": f"SELECT {columns} FROM sessions WHERE id = :session",
        "members": "SELECT * FROM members WHERE session = :session",
        "steps": "SELECT * FROM steps WHERE session = :session",
    }
    with transaction(connection):
        for table, query in rows.items():
            connection.execute(f"INSERT INTO project.{table} {query}", {"session": session})


def _check(path: Path) -> None:
    """Raise ``ValueError`` if a written project cannot be read back completely."""
    project = read_project(path)
    if project.lost:
        raise ValueError(project.lost[0])


def read_project(path: Path, current_state: State | None = None, copies: PhotoCopies | None = None) -> Project:
    """Read a project of any origin; parts that cannot be read are :attr:`Project.lost`. Objects are of no model yet.

    Args:
        current_state: state to show if none can be read; None: that is an error.
        copies: writes the copies of photo files; None writes none.

    Raises ``ValueError`` if it is no project.
    """
    with reading(path, "a project"), _untrusted(path) as connection:
        decoder = Decoder(Blobs(connection), copies.write if copies else None)
        reader = SessionReader(connection, decoder)
        (number,) = connection.execute("SELECT id FROM sessions ORDER BY id LIMIT 1").fetchone() or (None,)
        if number is None:
            raise ValueError("the project is empty")
        return reader.session(number, current_state, with_fits=True)


@contextmanager
def _untrusted(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a database from which nothing but our tables is read, and no code of the file runs."""
    if not path.is_file():
        raise FileNotFoundError(path)
    if path.stat().st_size > _MAX_FILE:
        raise ValueError(f"a project has at most {_MAX_FILE / 1e6:.0f} MB")
    address = f"file:{quote(path.absolute().as_posix())}?mode=ro&immutable=1"
    with closing(sqlite3.connect(address, uri=True)) as connection:
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, 4 * MAX_TEXT)
        for pragma in ("trusted_schema = OFF", "cell_size_check = ON", "query_only = ON", "mmap_size = 0"):
            connection.execute(f"PRAGMA {pragma}")
        until = time.monotonic() + _LONGEST
        connection.set_progress_handler(lambda: time.monotonic() > until, _STEPS)
        connection.set_authorizer(_authorize)
        _require_tables(connection)
        if is_sound(connection):
            yield connection
            return
        with closing(connect(None)) as copy:
            copy_readable(connection, copy)
            yield copy


def _require_tables(connection: sqlite3.Connection) -> None:
    """Raise ``ValueError`` unless the tables are those of this version, without views, triggers or formulas."""
    if connection.execute("PRAGMA application_id").fetchone() != (APPLICATION,):
        raise ValueError("another program has written it")
    if schema_version(connection) != VERSION:
        raise ValueError("another version of this program has written it")
    with closing(connect(None)) as empty:
        definitions, ours = (
            set(tables.execute("SELECT type, name, sql FROM sqlite_master")) for tables in (connection, empty)
        )
    if definitions != ours:
        raise ValueError("it has other tables than a project")


def _authorize(action: int, *names: str | None) -> int:
    """Permit reading tables, not by way of views or triggers; no functions, no changes."""
    return sqlite3.SQLITE_OK if action in _ALLOWED and names[-1] is None else sqlite3.SQLITE_DENY
