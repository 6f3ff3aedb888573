"""Keeps what a session makes as it happens; the next launch goes on with it, also after a crash."""

import operator
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future

from viewer.services.messages import MessageKind, Messages
from viewer.store.pictures import Pixels
from viewer.store.store import Store
from viewer.values.project import Project

BEAT = 10.0  # s between signs of life, and until a write that failed is repeated
Pictures = Callable[[], Mapping[str, Pixels]]  # makes images by name, which takes long


class Recording:
    """Writes every change to the store, which has a thread of its own."""

    def __init__(
        self,
        store: Store,
        messages: Messages,
        project: Callable[[], Project],
        state: Callable[[], tuple[object, ...]],
        pictures: Callable[[], Pictures | None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Prepare to record.

        Args:
            project: returns all that was made.
            state: returns its inputs; while they are the same objects, so is all that was made.
            pictures: returns the last images, or None if they are stored.
            clock: s.
        """
        self._store = store
        self._messages = messages
        self._project = project
        self._state = state
        self._pictures = pictures
        self._clock = clock
        self._written: tuple[object, ...] = ()  # inputs of the last write
        self._writing: Future[None] | None = None
        self._others: list[Future[None]] = []  # writes of other things than the project
        self._beaten = clock()
        self._retry = 0.0  # s on the clock until when nothing is written after a failure

    @property
    def is_up_to_date(self) -> bool:
        """True once everything that was made is in the store."""
        return self._writing is None and self._is_same()

    def _is_same(self) -> bool:
        state = self._state()
        return len(state) == len(self._written) and all(map(operator.is_, state, self._written))

    def tick(self, at_rest: bool) -> None:
        """Begin to write what has changed; call once a frame.

        Args:
            at_rest: no drag is in progress.
        """
        self._collect()
        now = self._clock()
        if at_rest and self._writing is None and now >= self._retry and not self._is_same():
            self._written = self._state()
            project = self._project()
            if not project.is_empty:
                self._writing = self._store.write(project)
        if now - self._beaten >= BEAT:
            self._beaten = now
            self._others.append(self._store.beat())
            self._keep_pictures()

    def _keep_pictures(self) -> None:
        if pictures := self._pictures():
            self._others.append(self._store.keep_pictures(pictures))

    def archive(self) -> None:
        """Make the session an earlier one."""
        self._others.append(self._store.archive(self._project()))
        self._written = ()

    def close(self) -> None:
        """Write everything for the next launch; report an error."""
        self._keep_pictures()
        try:
            self._store.close(self._project())
        except Exception as error:
            self._messages.report("Cannot keep what was made", error)
        self._collect()

    def _collect(self) -> None:
        """Report errors of finished writes."""
        if self._writing and self._writing.done():
            writing = self._writing
            self._writing = None
            if self._fails(writing):
                self._written = ()
                self._retry = self._clock() + BEAT
        for write in [write for write in self._others if write.done()]:
            self._others.remove(write)
            self._fails(write)
        while self._store.notes:
            self._messages.notify(self._store.notes.pop(0), MessageKind.NOTE)

    def _fails(self, write: Future[None]) -> bool:
        """Return whether a finished write failed, and report why."""
        error = write.exception()
        if isinstance(error, Exception):
            self._messages.report("Cannot keep what was made", error)
        return error is not None
