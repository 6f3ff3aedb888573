"""One window for each user's folder: a second start hands its files to the first one.

Imports nothing that takes long: the second start is to end at once.
"""

import hmac
import json
import os
import queue
import secrets
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, NamedTuple

_LOCK, _ADDRESS = "window.lock", "window.address"
"""the files in the folder: held by the window that is open, as long as it lives; its port and key, to be read by its
user alone"""
_HOST = "127.0.0.1"
_PATIENCE = 20.0  # s, for an answer: the window may be loading its libraries
_CLOSING = 60.0  # s that a start waits for a window which writes its session and ends
_MOST = 65_536  # bytes of a line
_TAKEN, _ENDS = b"taken\n", b"ends\n"


class Start(NamedTuple):
    """The wishes of a start: absolute paths, or names; empty where there is none."""

    image: str = ""  # a photo to rebuild
    model: str = ""


class SingleInstance:
    """The window of a folder listens on a port of this machine; its thread only collects what :meth:`starts` gives."""

    def __init__(self, folder: Path, lock: IO[bytes]) -> None:
        """Listen, and write down where. The lock is closed with it."""
        self._path, self._lock, self._key = folder / _ADDRESS, lock, secrets.token_hex(16)
        self.wake: Callable[[], None] = lambda: None  # called from a thread once there is a start to take
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
        with suppress(OSError):  # some systems keep a file that is being read; the next window writes it anew
            self._path.unlink()
        self._lock.close()

    def _listen(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:  # closed
                return
            threading.Thread(target=self._answer, args=(connection,), daemon=True).start()

    def _answer(self, connection: socket.socket) -> None:
        with connection, suppress(Exception):  # whatever another program may send
            connection.settimeout(_PATIENCE)
            with connection.makefile("rb") as lines:
                key, *wishes = map(str, json.loads(lines.readline(_MOST)))
            if not hmac.compare_digest(key, self._key):
                return
            start, ends = Start(*wishes), self._ends
            if not ends:
                self._starts.put(start)
                self.wake()
            connection.sendall(_ENDS if ends else _TAKEN)


def begin(folder: Path, start: Start) -> SingleInstance | None:
    """Become the window of a folder; None where one is open, which has been handed the start then.

    Raises ``TimeoutError`` where that does not answer for a minute.
    """
    folder.mkdir(parents=True, exist_ok=True)
    until = time.monotonic() + _CLOSING
    while time.monotonic() < until:
        if lock := _locked(folder / _LOCK):
            return SingleInstance(folder, lock)
        if _hand_over(folder / _ADDRESS, start) == _TAKEN:
            return None
        time.sleep(0.1)
    raise TimeoutError("a window is open already, but does not answer")


def _locked(path: Path) -> IO[bytes] | None:
    """The file, held until it is closed or this process ends, however it does; None while another process holds it."""
    file = path.open("ab")
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        file.close()
        return None
    except OSError:  # a file system without locks: any number of windows
        pass
    return file


def _hand_over(path: Path, start: Start) -> bytes:
    """The answer of the window that has written this file; empty where there is none."""
    try:
        port, key = path.read_text().split()
        with socket.create_connection((_HOST, int(port)), _PATIENCE) as connection:
            connection.sendall(json.dumps([key, *start]).encode() + b"\n")
            with connection.makefile("rb") as lines:
                return lines.readline(_MOST)
    except (OSError, ValueError, OverflowError):  # not written yet, or closed already
        return b""


def _write_address(path: Path, port: int, key: str) -> None:
    """Whole, in place of what a window that crashed has left."""
    partial = path.with_suffix(".new")
    partial.unlink(missing_ok=True)
    with os.fdopen(os.open(partial, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600), "w") as file:
        file.write(f"{port} {key}")
    partial.replace(path)
