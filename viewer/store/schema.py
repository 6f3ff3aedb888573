"""The tables of kept work, and connections to the databases that have them."""

import sqlite3
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

APPLICATION = 0x436F4E65  # in the header of our files
TABLES = "blobs", "parts", "models", "objects", "sessions", "members", "steps", "pictures"
"""Names of all tables; a row refers to rows of earlier tables only."""
_MIGRATIONS = (
    """
CREATE TABLE blobs (id INTEGER PRIMARY KEY AUTOINCREMENT, digest BLOB NOT NULL UNIQUE, content NOT NULL);
CREATE TABLE parts (whole INTEGER NOT NULL REFERENCES blobs ON DELETE CASCADE, part INTEGER NOT NULL REFERENCES blobs,
    PRIMARY KEY (whole, part));
CREATE TABLE models (fingerprint TEXT PRIMARY KEY, file TEXT NOT NULL);
CREATE TABLE objects (key INTEGER PRIMARY KEY, name TEXT NOT NULL, version_of INTEGER, fitted INTEGER NOT NULL,
    confidence REAL, codes INTEGER NOT NULL REFERENCES blobs, unedited INTEGER REFERENCES blobs,
    fit INTEGER REFERENCES blobs, mine INTEGER NOT NULL);
CREATE TABLE sessions (id INTEGER PRIMARY KEY AUTOINCREMENT, status TEXT NOT NULL, display TEXT NOT NULL,
    owner TEXT NOT NULL, seen REAL NOT NULL, changed REAL NOT NULL, crashes INTEGER NOT NULL DEFAULT 0,
    current INTEGER, tip INTEGER, pending INTEGER REFERENCES blobs, project TEXT);
CREATE TABLE members (session INTEGER NOT NULL REFERENCES sessions ON DELETE CASCADE,
    object INTEGER NOT NULL REFERENCES objects, PRIMARY KEY (session, object));
CREATE TABLE steps (session INTEGER NOT NULL REFERENCES sessions ON DELETE CASCADE, number INTEGER NOT NULL,
    parent INTEGER NOT NULL, state INTEGER NOT NULL REFERENCES blobs, PRIMARY KEY (session, number));
CREATE TABLE pictures (name TEXT PRIMARY KEY, width INTEGER NOT NULL, height INTEGER NOT NULL, pixels BLOB NOT NULL);
CREATE INDEX parts_part ON parts (part);
CREATE INDEX steps_state ON steps (state)
""",
)  # number n leads from version n to the next; a released one is never changed
VERSION = len(_MIGRATIONS)
_PATIENCE = 10.0  # s that a window waits while another one writes
_NETWORKS = ("nfs", "nfs4", "cifs", "smb3", "smbfs", "9p", "fuse.sshfs", "afs", "davfs")  # without shared memory


def connect(path: Path | None) -> sqlite3.Connection:
    """Open a database of kept work, made if there is none; None makes one in memory.

    Raises ``sqlite3.Error`` for a folder without access or a damaged file, ``ValueError`` for a newer version's file.
    """
    connection = sqlite3.connect(path or ":memory:", timeout=_PATIENCE, isolation_level=None, check_same_thread=False)
    try:
        connection.execute("PRAGMA trusted_schema = OFF")
        # The log of WAL needs memory that processes share, which network folders lack.
        connection.execute(f"PRAGMA journal_mode = {'TRUNCATE' if path and _is_on_network(path) else 'WAL'}")
        connection.execute("PRAGMA synchronous = NORMAL")  # :meth:`viewer.store.store.Store.beat` syncs
        migrate(connection)
        connection.execute("PRAGMA foreign_keys = ON")
    except Exception:
        connection.close()
        raise
    return connection


def connect_sound(path: Path) -> sqlite3.Connection | None:
    """Open a database as :func:`connect`; None if it is damaged, which is examined if a window has crashed."""
    try:
        connection = connect(path)
        left = connection.execute("SELECT 1 FROM sessions WHERE status = 'open'").fetchone()
        if left is None or is_sound(connection):
            return connection
        connection.close()
    except sqlite3.OperationalError:  # the folder takes no file
        raise
    except sqlite3.DatabaseError:
        pass
    return None


def migrate(connection: sqlite3.Connection) -> None:
    """Bring the tables to this version. Raises ``ValueError`` for a newer version's."""
    if (version := schema_version(connection)) == VERSION:
        return
    if version > VERSION:
        raise ValueError("a newer version of this program has written it")
    with transaction(connection):
        for migration in _MIGRATIONS[schema_version(connection) :]:  # another window may have migrated it meanwhile
            for statement in migration.split(";"):
                connection.execute(statement)
        connection.execute(f"PRAGMA user_version = {VERSION}")
        connection.execute(f"PRAGMA application_id = {APPLICATION}")


def schema_version(connection: sqlite3.Connection) -> int:
    """Return the number of migrations that a database has had."""
    return connection.execute("PRAGMA user_version").fetchone()[0]


@contextmanager
def transaction(connection: sqlite3.Connection) -> Iterator[None]:
    """Do everything inside or, after an error, nothing."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        with suppress(sqlite3.Error):  # some errors, such as a full disk, have rolled back already
            connection.execute("ROLLBACK")
        raise


def _is_on_network(path: Path) -> bool:
    """Return whether a folder is another machine's, as far as its system tells."""
    folder = str(path.absolute())
    if folder.startswith("\\\\"):
        return True
    kind = longest = ""
    if sys.platform == "linux":
        with suppress(OSError), closing(Path("/proc/mounts").open()) as mounts:
            for _, mount, mount_kind, *_ in map(str.split, mounts):
                if len(mount) >= len(longest) and f"{folder}/".startswith(f"{mount.rstrip('/')}/"):
                    kind = mount_kind
                    longest = mount
    return kind in _NETWORKS


def recovered(path: Path) -> Path:
    """Set a damaged database aside, and return its path there; the readable rows are copied into a new one.

    Rows that refer to lost ones are left out. Raises ``OSError`` or ``sqlite3.Error`` if the folder denies that.
    """
    aside = path.with_name(f"{path.stem} damaged{path.suffix}")
    count = 1
    while aside.exists():
        count += 1
        aside = path.with_name(f"{path.stem} damaged {count}{path.suffix}")
    for ending in ("-wal", "-shm", ""):
        with suppress(FileNotFoundError):
            path.with_name(path.name + ending).rename(aside.with_name(aside.name + ending))
    with closing(connect(path)) as new, closing(sqlite3.connect(aside)) as old:
        copy_readable(old, new)
    return aside


def copy_readable(old: sqlite3.Connection, new: sqlite3.Connection) -> None:
    """Copy the readable rows of a damaged database into an empty one, without those that refer to lost ones."""
    new.execute("PRAGMA foreign_keys = OFF")
    with transaction(new):
        for table in TABLES:
            for row in _readable_rows(old, table):
                with suppress(sqlite3.Error):
                    new.execute(f"INSERT OR IGNORE INTO {table} VALUES ({','.join('?' * len(row))})", row)
        for table, column in (("objects", "unedited"), ("objects", "fit"), ("sessions", "pending")):
            new.execute(f"UPDATE {table} SET {column} = NULL WHERE {column} NOT IN (SELECT id FROM blobs)")
        while orphans := new.execute("PRAGMA foreign_key_check").fetchall():
            for table, row_id, *_ in orphans:
                new.execute(f"DELETE FROM {table} WHERE rowid = ?", (row_id,))


def _readable_rows(connection: sqlite3.Connection, table: str) -> Iterator[tuple]:
    """Yield the rows from either end of a table to its first damaged page."""
    for order in ("ASC", "DESC"):
        try:
            yield from connection.execute(f"SELECT * FROM {table} ORDER BY rowid {order}")
        except sqlite3.Error:
            continue  # from the other end
        return


def is_sound(connection: sqlite3.Connection) -> bool:
    """Return whether a database has no damaged page."""
    with suppress(sqlite3.Error):
        return connection.execute("PRAGMA quick_check(1)").fetchone() == ("ok",)
    return False
