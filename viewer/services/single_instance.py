"""One window for each user's folder: a second start hands its files to the first one.

Imports nothing that takes long: the second start is to end at once.
"""

import hmac
import json
import os
import queue
import secrets
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

_ADDRESS = "window.address"
"""the file in the folder: port and key of the window that is open, to be read by its user alone"""
_HOST = "127.0.0.1"
_PATIENCE = 3.0
"""s: a window that does not answer within this is taken to be dead"""
_CLOSING = 60.0
"""s that a start waits for a window which writes its session and ends"""
_MOST = 65_536
"""bytes of a line"""
_TAKEN, _ENDS = b"taken\n", b"ends\n"


class Start(NamedTuple):
    """The wishes of a start: absolute paths, or names; empty where there is none."""

    image: str = ""
    """a photo to rebuild"""
    model: str = ""


class SingleInstance:
    """The window of a folder listens on a port of this machine; its thread only collects what :meth:`starts` gives."""

    def __init__(self, folder: Path) -> None:
        """Listen, and write down where. Raises ``FileExistsError`` where another window has done so first."""
        self._path, self._key = folder / _ADDRESS, secrets.token_hex(16)
        self.wake: Callable[[], None] = lambda: None
        """called from the thread once there is a start to take"""
        self._starts = queue.SimpleQueue[Start]()
        self._ends = False
        self._listener = socket.create_server((_HOST, 0))
        try:
            _write_address(self._path, self._listener.getsockname()[1], self._key)
        except OSError:
            self._listener.close()
            raise
        threading.Thread(target=self._listen, name="second starts", daemon=True).start()

    def starts(self) -> Iterator[Start]:
        """Those that have come since the last call."""
        with suppress(queue.Empty):
            while True:
                yield self._starts.get_nowait()

    def end(self) -> None:
        """Take no more: a start from now on waits until this window is gone."""
        self._ends = True

    def close(self) -> None:
        """Leave the folder to the next window."""
        self.end()
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)  # closed alone, it would go on accepting
        self._listener.close()
        if _read_address(self._path)[1] == self._key:  # another has taken over from one that did not answer
            self._path.unlink(missing_ok=True)

    def _listen(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:  # closed
                return
            with connection, suppress(Exception):  # whatever another program may send
                connection.settimeout(_PATIENCE)
                self._answer(connection)

    def _answer(self, connection: socket.socket) -> None:
        with connection.makefile("rb") as lines:
            key, *wishes = map(str, json.loads(lines.readline(_MOST)))
        if not hmac.compare_digest(key, self._key):
            return
        start = Start(*wishes)
        if not self._ends:
            self._starts.put(start)
            self.wake()
        connection.sendall(_ENDS if self._ends else _TAKEN)


def begin(folder: Path, start: Start) -> SingleInstance | None:
    """Become the window of a folder; None where one is open, which has been handed the start then. What a window that
    crashed has left is cleared away.
    """
    folder.mkdir(parents=True, exist_ok=True)
    until = time.monotonic() + _CLOSING
    while True:
        try:
            return SingleInstance(folder)
        except FileExistsError:
            answer = _hand_over(folder / _ADDRESS, start)
        if answer == _TAKEN:
            return None
        if answer == _ENDS and time.monotonic() < until:
            time.sleep(0.1)
        else:
            (folder / _ADDRESS).unlink(missing_ok=True)


def _hand_over(path: Path, start: Start) -> bytes:
    """The answer of the window that has written this file; empty where there is none."""
    port, key = _read_address(path)
    try:
        with socket.create_connection((_HOST, port), _PATIENCE) as connection:
            connection.sendall(json.dumps([key, *start]).encode() + b"\n")
            with connection.makefile("rb") as lines:
                return lines.readline(_MOST)
    except (OSError, OverflowError):
        return b""


def _write_address(path: Path, port: int, key: str) -> None:
    with os.fdopen(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600), "w") as file:
        file.write(f"{port} {key}")


def _read_address(path: Path) -> tuple[int, str]:
    """Port and key; a port that nobody listens on where the file cannot be read."""
    try:
        port, key = path.read_text().split()
        return int(port), key
    except (OSError, ValueError):
        return 0, ""
