"""One window per display and folder: a second start passes its files to the open window.

Imports nothing slow, so that a second start ends at once.
"""

import json
import os
import platform
import re
import secrets
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from filelock import FileLock, Timeout

from core.runtime.files import write_json

_PATIENCE = 60.0  # s that a start waits for a window that is opening, or saving its session at its end
_POLL = 0.2  # s


class Start(NamedTuple):
    """The request of a start. Paths are absolute, empty for none."""

    image: str = ""  # path of a photo to fit
    model: str = ""  # shipped name or path of a model to show


class SingleInstance:
    """The only window of a display. Second starts write files into its folder, which :meth:`starts` reads."""

    def __init__(self, folder: Path, lock: FileLock) -> None:
        """Watch a folder whose lock is held, until :meth:`close` or the end of the process."""
        self._folder = folder
        self._lock = lock
        self._ends = False

    def starts(self) -> Iterator[Start]:
        """Yield and remove the second starts since the last call; none after :meth:`end`."""
        for path in () if self._ends else sorted(self._folder.glob("[!.]*.json")):
            text = path.read_text()
            path.unlink()
            if start := _start(text):
                yield start

    def end(self) -> None:
        """Accept no more second starts: they wait and open their own window after :meth:`close`."""
        self._ends = True

    def close(self) -> None:
        """Release the display for the next window."""
        self.end()
        self._lock.release()


def _start(text: str) -> Start | None:
    """Parse a second start; None for another program's file."""
    with suppress(ValueError, TypeError):
        return Start(**json.loads(text))
    return None


def begin(folder: Path, start: Start, display: str | None = None) -> SingleInstance | None:
    """Become the window of a display; None if an open window has taken the start.

    Args:
        folder: the user's folder, with a subfolder per display.
        display: name of the display; None: the current one.

    Raises ``TimeoutError`` if an open window does not take the start within a minute.
    """
    window_folder = folder / f"window-{display_name() if display is None else display}"
    window_folder.mkdir(parents=True, exist_ok=True)
    lock = FileLock(window_folder / "lock")
    wish = window_folder / f"{secrets.token_hex(8)}.json"
    until = time.monotonic() + _PATIENCE
    write_json(wish, start._asdict())
    try:
        while time.monotonic() < until:
            if not wish.exists():  # checked first, as the window that took it may have ended
                return None
            if _is_free(lock):
                return SingleInstance(window_folder, lock)
            time.sleep(_POLL)
    finally:
        wish.unlink(missing_ok=True)
    raise TimeoutError("a window is open already, but does not answer")


def _is_free(lock: FileLock) -> bool:
    """Try to acquire the lock; return False if another window holds it, True on a file system without locks."""
    try:
        lock.acquire(timeout=0)
    except Timeout:
        return False
    except (NotImplementedError, OSError):
        pass
    return True


def display_name() -> str:
    """Return a file name of the machine and the current display."""
    words = platform.node(), os.environ.get("WAYLAND_DISPLAY", ""), os.environ.get("DISPLAY", "")
    return re.sub(r"\W+", "-", "-".join(filter(None, words)))
