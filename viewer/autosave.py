"""Autosave: work is saved during editing and restored at the next launch, also after a crash."""

import secrets
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from filelock import FileLock, Timeout

from viewer.services.kept_thumbnails import write_pictures
from viewer.services.messages import Button, MessageKind
from viewer.session import PICTURES, Session
from viewer.values.project import SUFFIX, Project, left_out

EVERY = 5.0  # least s between two saves
_EARLIER = 10  # replaced sessions that are kept
_DAY = 86_400.0  # s after which a killed run's partial file is removed


class Autosave:
    """Keeps one file per run, which the next run continues; a crashed run's file is offered to be restored."""

    def __init__(self, session: Session, folder: Path, clock: Callable[[], float] = time.monotonic) -> None:
        """Continue the session in ``folder``, save there every few seconds, and offer to restore crashed runs."""
        self._session, self._clock = session, clock
        self._kept_file, self._pictures_file = folder / f"session{SUFFIX}", folder / PICTURES
        self._earlier = folder / "earlier"
        self._own_file = folder / f"session-{secrets.token_hex(8)}{SUFFIX}"
        self._lock = _lock(self._own_file)
        self._written: tuple[object, ...] = ()  # contents of the last save
        self._when = clock()  # s of the last save
        self._thread = ThreadPoolExecutor(1, "autosave")
        self._writing: Future[int] | None = None
        found = [path for path in folder.glob(f"session-*{SUFFIX}") if not _runs(path)]
        with suppress(Timeout, OSError):  # the folder is not writable
            self._lock.acquire(timeout=0)
        _sweep(folder)
        self.recoverable: tuple[Path, ...] = tuple(sorted(found, key=lambda path: path.stat().st_mtime))
        """Files of crashed runs, the newest last, which is offered first."""
        session.archive.connect(self._archive)
        self._resume()
        self._offer()

    @property
    def earlier(self) -> tuple[Path, ...]:
        """Files of replaced sessions, the newest first."""
        return tuple(sorted(self._earlier.glob(f"*{SUFFIX}"), reverse=True))

    def tick(self) -> None:
        """Begin to save if anything has changed and no drag is in progress; call once a frame."""
        if self._writing and self._writing.done():
            self.finish()
        state = self._session.tracked_state
        if self._session.editor.history.gesture or _are_same(state, self._written):
            return
        if self._writing is None and self._clock() - self._when >= EVERY:
            self._when, self._written = self._clock(), state
            if not (project := self._session.project()).is_empty:
                write_pictures(self._pictures_file, self._session.pictures)
                self._writing = self._thread.submit(project.save, self._own_file, self._session.models)

    def finish(self) -> None:
        """Wait for the current save and report its result."""
        if self._writing:
            writing, self._writing = self._writing, None
            self._tell(writing.result)

    def _offer(self) -> None:
        """Offer to restore the newest crashed run; delete an empty one."""
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
        self._session.messages.notify(text, MessageKind.NOTE, buttons=buttons)

    def restore(self) -> None:
        """Add the newest crashed run to the session; on failure keep its file and offer it again."""
        path = self.recoverable[-1]
        try:
            self._session.restore(Project.load(path, self._session.models))
        except ValueError as error:
            self._session.messages.report("Cannot restore the session", error)
            self._offer()
        else:
            self._discard(path)

    def discard(self) -> None:
        """Delete the newest crashed run and offer the next."""
        self._discard(self.recoverable[-1])

    def _discard(self, path: Path) -> None:
        path.unlink(missing_ok=True)
        self.recoverable = tuple(one for one in self.recoverable if one != path)
        self._offer()

    def close(self) -> None:
        """Save the session for the next run; files of crashed runs stay until a person decides."""
        self.finish()
        self._thread.shutdown()
        self._keep()
        write_pictures(self._pictures_file, self._session.pictures)
        self._lock.release()
        Path(self._lock.lock_file).unlink(missing_ok=True)

    def _keep(self) -> None:
        """Write the session to the file that the next run continues."""
        # If another window has written that file, the next run continues it and offers this session.
        to = self._own_file if self._kept_file.exists() else self._kept_file
        if self._write(self._session.project(), to) and to == self._kept_file:
            self._own_file.unlink(missing_ok=True)

    def _resume(self) -> None:
        """Continue the last session. Its file is renamed first, so that a project that crashes is not loaded again."""
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
        return self._tell(lambda: project.save(path, self._session.models))

    def _tell(self, save: Callable[[], int]) -> bool:
        """Call ``save``; report an error, or undo steps left out; return whether a file was written."""
        try:
            dropped = save()
        except (ValueError, OSError) as error:
            self._session.messages.report("Cannot save the session", error)
            return False
        if dropped:
            self._session.messages.notify(left_out("session", dropped), MessageKind.NOTE)
        return True


def _are_same(first: tuple[object, ...], second: tuple[object, ...]) -> bool:
    """Return whether all values are the same objects; comparing their contents would take long."""
    return len(first) == len(second) and all(one is other for one, other in zip(first, second, strict=True))


def _lock(path: Path) -> FileLock:
    """Return the lock that a run holds on its file until it ends."""
    return FileLock(path.with_name(f".{path.stem}.lock"), thread_local=False)


def _runs(path: Path) -> bool:
    """Return whether a file's run is alive, on any machine."""
    lock = _lock(path)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        return True
    except (NotImplementedError, OSError):  # no locks here
        return False
    lock.release()
    Path(lock.lock_file).unlink(missing_ok=True)
    return False


def _sweep(folder: Path) -> None:
    """Remove partial files of killed runs."""
    for path in folder.glob(".*.partial*"):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > _DAY:
                path.unlink()
