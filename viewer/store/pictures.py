"""The last images of view and tiles, which the next launch shows at once."""

import sqlite3
import zlib
from collections.abc import Mapping
from contextlib import suppress

import numpy as np
from jaxtyping import UInt8

from viewer.store.schema import transaction

Pixels = UInt8[np.ndarray, "height width 4"]  # RGB on white, and opacity
_RENDERS = "3 "  # begin of names; another one if renders change
_TILE = 64  # px: larger images are of views
_MAX_TILES, _MAX_VIEWS = 300, 3  # images that are kept
_MAX_BYTES = 64_000_000  # of pixels


def read_pictures(connection: sqlite3.Connection) -> dict[str, Pixels]:
    """Return images by name, the oldest first, without those on damaged pages or damaged themselves."""
    pictures = dict[str, Pixels]()
    with suppress(sqlite3.Error):
        rows = connection.execute("SELECT name, width, height, pixels FROM pictures ORDER BY rowid")
        for name, width, height, pixels in rows:
            if name.startswith(_RENDERS) and 0 < 4 * width * height <= _MAX_BYTES:
                with suppress(zlib.error, ValueError):
                    content = zlib.decompressobj().decompress(pixels, 4 * width * height)
                    pictures[name.removeprefix(_RENDERS)] = np.frombuffer(content, np.uint8).reshape(height, width, 4)
    return pictures


def write_pictures(connection: sqlite3.Connection, pictures: Mapping[str, Pixels]) -> None:
    """Store new images, and delete the oldest ones beyond a limit."""
    with transaction(connection):
        stored = {name for (name,) in connection.execute("SELECT name FROM pictures")}
        for name, pixels in pictures.items():
            if f"{_RENDERS}{name}" not in stored or max(pixels.shape) > _TILE:
                height, width = pixels.shape[:2]
                values = f"{_RENDERS}{name}", width, height, zlib.compress(pixels.tobytes(), 1)
                connection.execute("INSERT OR REPLACE INTO pictures VALUES (?, ?, ?, ?)", values)
        for comparison, limit in (("<=", _MAX_TILES), (">", _MAX_VIEWS)):
            of_kind = f"max(width, height) {comparison} {_TILE}"
            newest = f"SELECT rowid FROM pictures WHERE {of_kind} ORDER BY rowid DESC LIMIT {limit}"
            connection.execute(f"DELETE FROM pictures WHERE {of_kind} AND rowid NOT IN ({newest})")
