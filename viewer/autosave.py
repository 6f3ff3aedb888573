"""The session written down while it is edited, and what a run that ended badly has left."""

import os
import secrets
import sys
import time
from collections.abc import Callable
from pathlib import Path

from core.files import atomic_file
from viewer.session import Session
from viewer.values.saved_session import SavedSession

_EVERY = 5.0
"""s between two writings at the least"""


class Autosave:
    """A file for every run, which goes when the run ends well; one that is left belongs to a run that did not."""

    def __init__(
        self,
        session: Session,
        folder: Path,
        clock: Callable[[], float] = time.monotonic,
        every: float = _EVERY,
    ) -> None:
        """Look for what was left in ``folder``, and write there, at most once in so many seconds."""
        self._session, self._clock, self.every = session, clock, every
        self._file = folder / f"session-{os.getpid()}-{secrets.token_hex(4)}.json"
        self._written: object = None
        """the state in the file"""
        self._when = clock()
        found = [path for path in folder.glob("session-*.json") if path != self._file and not _runs(path)]
        self.left: tuple[Path, ...] = tuple(sorted(found, key=lambda path: path.stat().st_mtime))
        """what was left, the last one at the end, which is offered; those before it, once that has been answered"""
        self.times = tuple(path.stat().st_mtime for path in self.left)
        """s since the epoch, when each was written"""

    def tick(self) -> None:
        """Once a frame: write, if there is something new and no drag is under way."""
        workspace = self._session.workspace
        if workspace is None or workspace.editor.history.gesture or workspace.editor.state is self._written:
            return
        if self._clock() - self._when >= self.every and (saved := self._session.save()):
            self._write(saved, workspace.editor.state)

    def restore(self) -> None:
        """Continue what was left last. Where that cannot be, it stays until it is discarded."""
        try:
            saved = SavedSession.read(self.left[-1].read_text())
        except (ValueError, OSError) as error:
            self._session.messages.report("Cannot restore the session", error)
        else:
            self._session.restore(saved, self.discard)

    def discard(self) -> None:
        """Delete what was left last."""
        self.left[-1].unlink(missing_ok=True)
        self.left, self.times = self.left[:-1], self.times[:-1]

    def close(self) -> None:
        """The run ends well; what an earlier one left stays until someone has decided."""
        self._file.unlink(missing_ok=True)

    def _write(self, saved: SavedSession, state: object) -> None:
        self._when, self._written = self._clock(), state
        try:
            with atomic_file(self._file) as partial:
                partial.write_text(saved.text)
        except ValueError as error:
            self._session.messages.report("Cannot save the session", error)


def _runs(path: Path) -> bool:
    """Whether the program that writes this file is still there. On Windows this cannot be found out."""
    number = path.stem.removeprefix("session-").partition("-")[0]
    if not number.isdigit() or sys.platform == "win32" or int(number) == os.getpid():
        return False  # an earlier run had this one's number
    try:
        os.kill(int(number), 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True
