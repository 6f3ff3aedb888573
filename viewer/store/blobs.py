"""Contents by their hash, once each: bytes, and JSON that refers to other contents by number."""

import hashlib
import sqlite3
from collections.abc import Iterable, MutableMapping
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

from core.runtime.reading import parse_json

T = TypeVar("T", bytes, str)

_USED = """WITH RECURSIVE used(id) AS (
    SELECT codes FROM objects WHERE {objects} UNION SELECT unedited FROM objects WHERE unedited NOT NULL AND {objects}
    UNION SELECT fit FROM objects WHERE fit NOT NULL AND {objects} UNION SELECT state FROM steps WHERE {steps}
    UNION SELECT pending FROM sessions WHERE pending NOT NULL AND {sessions}
    UNION SELECT part FROM parts JOIN used ON whole = used.id)"""
USED = _USED.format(objects="TRUE", steps="TRUE", sessions="TRUE")
"""Begin of a query: the contents that rows of objects and sessions need, as the table ``used``."""
USED_BY_SESSION = _USED.format(
    objects="key IN (SELECT object FROM members WHERE session = :session)",
    steps="session = :session",
    sessions="id = :session",
)  # begin of a query: the contents that rows of a session and its objects need


class Blobs:
    """The contents of a database."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection
        self.numbers: MutableMapping[Any, int] = WeakKeyDictionary()
        """Numbers of values in memory. Another window may delete their contents, after which nothing is known."""

    def add(self, content: bytes | str, parts: Iterable[int] = ()) -> int:
        """Store a content unless it is there, with the numbers of the contents that it refers to; return its number."""
        digest = digest_of(content)
        if (number := self.find(digest)) is not None:
            return number
        inserted = self._connection.execute("INSERT INTO blobs (digest, content) VALUES (?, ?)", (digest, content))
        number = inserted.lastrowid
        assert number is not None
        self._connection.executemany("INSERT INTO parts VALUES (?, ?)", ((number, part) for part in parts))
        return number

    def find(self, digest: bytes) -> int | None:
        """Return the number of the content with a digest, if it is there."""
        row = self._connection.execute("SELECT id FROM blobs WHERE digest = ?", (digest,)).fetchone()
        return row[0] if row else None

    def content(self, number: int, kind: type[T]) -> T:
        """Return a content of type bytes or str by its number. Raises ``ValueError`` if it is missing."""
        row = self._connection.execute("SELECT content FROM blobs WHERE id = ?", (number,)).fetchone()
        if row and isinstance(row[0], kind):
            return row[0]
        raise ValueError(f"the content {number} is missing")

    def record(self, number: int) -> Any:
        """Return a content that is JSON. Raises ``ValueError`` for any other."""
        return parse_json(self.content(number, str))

    def sweep(self) -> None:
        """Delete the objects that nobody lists and no session has, and the contents that no row needs."""
        self._connection.execute("DELETE FROM objects WHERE NOT mine AND key NOT IN (SELECT object FROM members)")
        self._connection.execute(f"{USED} DELETE FROM blobs WHERE id NOT IN (SELECT id FROM used)")
        self.numbers.clear()


def digest_of(content: bytes | str) -> bytes:
    """Return the hash of a content; that of a text differs from that of its bytes."""
    if isinstance(content, str):
        return hashlib.blake2b(content.encode(), digest_size=16, person=b"text").digest()
    return hashlib.blake2b(content, digest_size=16).digest()
