"""Autosave: the work, written down while it is edited, kept from launch to launch, and after a run that ended badly."""

import os
import secrets
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from viewer.services.messages import Button, MessageKind
from viewer.session import Session
from viewer.values.project import SUFFIX, Project

_EVERY = 5.0  # s between two writings at the least
_EARLIER = 10  # sessions that were replaced, kept


class Autosave:
    """A file for every run. At its end it becomes the one that the next run begins with; one that is left belongs to a
    run that ended badly, and is offered.
    """

    def __init__(
        self,
        session: Session,
        folder: Path,
        clock: Callable[[], float] = time.monotonic,
        every: float = _EVERY,
    ) -> None:
        """Go on with what was kept in ``folder``, look for what was left there, and write there, at most once in so
        many seconds.
        """
        self._session, self._clock, self.every = session, clock, every
        self._kept_file = folder / f"session{SUFFIX}"
        self._earlier = folder / "earlier"
        self._own_file = folder / f"session-{os.getpid()}-{secrets.token_hex(4)}{SUFFIX}"
        self._written: tuple[object, ...] = ()  # what the file holds
        self._when = clock()
        found = [path for path in folder.glob(f"session-*{SUFFIX}") if not _runs(path)]
        self.recoverable: tuple[Path, ...] = tuple(sorted(found, key=lambda path: path.stat().st_mtime))
        """what was left, the last one at the end, which is offered; those before it, once that has been answered"""
        session.archive.connect(self._archive)
        self._resume()
        self._offer()

    @property
    def earlier(self) -> tuple[Path, ...]:
        """Sessions that were replaced by others, the last one first."""
        return tuple(sorted(self._earlier.glob(f"*{SUFFIX}"), reverse=True))

    def tick(self) -> None:
        """Once a frame: write, if there is something new and no drag is under way."""
        parts = self._session.parts
        if self._session.editor.history.gesture or _are_same(parts, self._written):
            return
        if self._clock() - self._when >= self.every:
            self._when, self._written = self._clock(), parts
            if not (project := self._session.project()).is_empty:
                self._write(project, self._own_file)

    def _offer(self) -> None:
        """Ask whether to restore what was left last, telling what it holds; where that is nothing, it goes."""
        if not self.recoverable:
            return
        path, held = self.recoverable[-1], "nobody knows what"
        with suppress(ValueError):
            held = Project.load(path, self._session.models).summary
        if not held:
            self.discard()
            return
        when = datetime.fromtimestamp(path.stat().st_mtime)
        text = f"A session did not end well: {held}, saved on {when:%d %B at %H:%M}"
        buttons = Button("Restore", self.restore), Button("Discard", self.discard)
        self._session.messages.notify(text, MessageKind.NOTE, buttons=buttons, lasts=True)

    def restore(self) -> None:
        """Add what was left last to what there is. Where that cannot be, it stays until it is discarded."""
        path = self.recoverable[-1]
        try:
            self._session.restore(Project.load(path, self._session.models))
        except ValueError as error:
            self._session.messages.report("Cannot restore the session", error)
            self._offer()
        else:
            self._discard(path)

    def discard(self) -> None:
        """Delete what was left last, and offer what was left before it."""
        self._discard(self.recoverable[-1])

    def _discard(self, path: Path) -> None:
        path.unlink(missing_ok=True)
        self.recoverable = tuple(one for one in self.recoverable if one != path)
        self._offer()

    def close(self) -> None:
        """The run ends well; what an earlier one left stays until someone has decided."""
        # Where another window was closed meanwhile, the next launch begins with its session, and offers this one.
        to = self._own_file if self._kept_file.exists() else self._kept_file
        if self._write(self._session.project(), to) and to == self._kept_file:
            self._own_file.unlink(missing_ok=True)

    def _resume(self) -> None:
        """Take over the file by renaming it: a project that crashes the program is not loaded at the next start."""
        try:
            self._kept_file.replace(self._own_file)
            project = Project.load(self._own_file, self._session.models)
            self._session.restore(project)
            self._session.project_path = project.path
        except FileNotFoundError:
            pass
        except (ValueError, OSError) as error:
            self._session.messages.report("Cannot go on with the last session", error)
            if self._own_file.exists():
                self._own_file.replace(self._archive_path())

    def _archive(self, project: Project) -> None:
        self._write(project, self._archive_path())
        for path in self.earlier[_EARLIER:]:
            path.unlink(missing_ok=True)

    def _archive_path(self) -> Path:
        self._earlier.mkdir(parents=True, exist_ok=True)
        return self._earlier / f"{datetime.now():%Y-%m-%d %H.%M.%S.%f}{SUFFIX}"

    def _write(self, project: Project, path: Path) -> bool:
        try:
            project.save(path, self._session.models)
        except (ValueError, OSError) as error:
            self._session.messages.report("Cannot save the session", error)
            return False
        return True


def _are_same(first: tuple[object, ...], second: tuple[object, ...]) -> bool:
    """The very same values: comparing them by their numbers would take long."""
    return len(first) == len(second) and all(one is other for one, other in zip(first, second, strict=True))


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
