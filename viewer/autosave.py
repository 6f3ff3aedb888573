"""Autosave: work is saved during editing and continued at the next launch, also after a crash."""

import math
import operator
import secrets
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from filelock import FileLock, Timeout

from core.detail.progressive import Frame
from viewer.services.messages import MessageKind
from viewer.services.pictures import Pixels, write_pictures
from viewer.session import PICTURES, Session
from viewer.values.project import SUFFIX, Project

EVERY = 5.0  # least s between two saves
EVERY_PICTURES = 20.0  # least s from a save to one of images alone, which are 25 MB of a large window
_ENDED, _RUNNING, _AGAIN = "session", "running", "again"  # files of an ended run, a running one, one after a crash
EARLIER = 10  # replaced sessions that are kept


class Autosave:
    """Keeps one file per run, which the next run continues.

    After two crashes in a row a session is only kept among the earlier ones, as it may end the program again.
    """

    def __init__(self, session: Session, folder: Path, clock: Callable[[], float] = time.monotonic) -> None:
        """Continue the newest session in ``folder`` that no other run has, and save there every few seconds."""
        self._session = session
        self._clock = clock
        self._pictures_file = folder / PICTURES
        self._earlier = folder / "earlier"
        self._written: tuple[object, ...] = ()  # contents of the last save
        self._pictures: tuple[Frame | None, int] | None = None  # images of the last save
        self._when = clock()  # s of the last save
        self._thread = ThreadPoolExecutor(1, "autosave")
        self._writing: Future[None] | None = None
        paths = [path for kind in (_ENDED, _RUNNING, _AGAIN) for path in folder.glob(f"{kind}*{SUFFIX}")]
        left = sorted((path for path in paths if not _runs(path)), key=lambda path: path.stat().st_mtime)
        crashed = bool(left) and not left[-1].name.startswith(_ENDED)
        token = secrets.token_hex(8)
        self._own_file = folder / f"{_AGAIN if crashed else _RUNNING}-{token}{SUFFIX}"
        self._ended_file = folder / f"{_ENDED}-{token}{SUFFIX}"
        self._lock = _lock(self._own_file)
        with suppress(Timeout, OSError):  # the folder is not writable
            self._lock.acquire(timeout=0)
        session.archive.connect(self._archive)
        if left:
            self._resume(left)

    @property
    def earlier(self) -> tuple[Path, ...]:
        """Files of replaced sessions, the newest first."""
        return tuple(sorted(self._earlier.glob(f"*{SUFFIX}"), reverse=True))

    @property
    def is_up_to_date(self) -> bool:
        """True once everything that was made is in the file."""
        return self._writing is None and self._is_written

    @property
    def _is_written(self) -> bool:
        """True if the last save, perhaps under way, has everything that was made."""
        return _are_same(self._session.tracked_state, self._written)

    def tick(self) -> None:
        """Begin to save if anything has changed and no drag is in progress; call once a frame.

        Finished images are saved, too, so that little is left to be written when the window closes.
        """
        if self._writing and self._writing.done():
            self.finish()
        passed = self._clock() - self._when
        if self._session.editor.history.gesture or self._writing or passed < EVERY:
            return
        if not self._is_written:
            self._written = self._session.tracked_state
            self._begin(None if (project := self._session.project()).is_empty else project)
        elif passed >= EVERY_PICTURES and self._session.is_rendered and self._have_new_pictures():
            self._begin(None)

    def _begin(self, project: Project | None) -> None:
        """Begin to write the images, and a project."""
        self._when = self._clock()
        self._pictures = self._session.picture_state
        self._writing = self._thread.submit(self._save, project, self._session.pictures)

    def _save(self, project: Project | None, pictures: Mapping[str, Pixels]) -> None:
        write_pictures(self._pictures_file, pictures)
        if project:
            self._session.keep_edits(project)
            project.save(self._own_file, self._session.models)

    def _have_new_pictures(self) -> bool:
        """Return whether the view or a tile has another image than in the file."""
        before = self._pictures
        now = self._session.picture_state
        return before is None or before[0] is not now[0] or before[1] != now[1]

    def finish(self) -> None:
        """Wait for the current save and report its result."""
        if self._writing:
            writing = self._writing
            self._writing = None
            if not self._tell(writing.result):
                self._written = ()

    def close(self) -> None:
        """Save all changes since the last save, for the next run."""
        self.finish()
        self._thread.shutdown()
        self._session.kept_objects.store()
        self._session.sweep_photos()
        project = self._session.project()
        if project.is_empty:
            self._own_file.unlink(missing_ok=True)
        elif self._is_written or self._write(project, self._own_file):
            self._own_file.replace(self._ended_file)
        if self._have_new_pictures():
            write_pictures(self._pictures_file, self._session.pictures)
        self._lock.release()
        Path(self._lock.lock_file).unlink(missing_ok=True)

    def _resume(self, left: list[Path]) -> None:
        """Continue the newest of these sessions; the others become earlier ones.

        The files are moved first, so that a session that ends the program is not loaded again.
        """
        try:
            *_, moved = map(self._keep_as_earlier, left)
            if left[-1].name.startswith(_AGAIN):
                text = "The program ended twice in the last session, so it was not opened: see File, Recent"
                self._session.messages.notify(text, MessageKind.NOTE)
                return
            project = Project.load(moved, self._session.models)
            self._session.restore(project)
            self._session.project_path = project.path
            moved.replace(self._own_file)
        except (ValueError, OSError) as error:
            self._session.messages.report("Cannot go on with the last session", error)

    def _archive(self, project: Project) -> None:
        """Keep a replaced project among the earlier ones; its last save if it cannot be written."""
        self.finish()
        if self._tell(lambda: project.save(self._archive_path(time.time()), self._session.models)):
            self._own_file.unlink(missing_ok=True)
        elif self._own_file.exists():
            self._tell(lambda: self._keep_as_earlier(self._own_file))
        self._when = -math.inf  # the photos that wait are in no file now
        for path in self.earlier[EARLIER:]:
            path.unlink(missing_ok=True)

    def _keep_as_earlier(self, path: Path) -> Path:
        return path.replace(self._archive_path(path.stat().st_mtime))

    def _archive_path(self, when: float) -> Path:
        self._earlier.mkdir(parents=True, exist_ok=True)
        return self._earlier / f"{datetime.fromtimestamp(when):%Y-%m-%d %H.%M.%S.%f}{SUFFIX}"

    def _write(self, project: Project, path: Path) -> bool:
        return self._tell(lambda: project.save(path, self._session.models))

    def _tell(self, save: Callable[[], object]) -> bool:
        """Call ``save``; report an error; return whether a file was written."""
        try:
            save()
        except (ValueError, OSError) as error:
            self._session.messages.report("Cannot save the session", error)
            return False
        return True


def _are_same(first: tuple[object, ...], second: tuple[object, ...]) -> bool:
    """Return whether all values are the same objects; comparing their contents would take long."""
    return len(first) == len(second) and all(map(operator.is_, first, second))


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
