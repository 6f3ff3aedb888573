"""The recording of a session as it is made, with which the next launch goes on, also after a crash."""

import operator
import time
from collections.abc import Callable, Mapping

from viewer.services.messages import OK, MessageKind, Messages
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
    ) -> None:
        """Prepare to record.

        Args:
            project: returns the project of the session.
            state: returns its inputs; while they are the same objects, so is the project.
            pictures: returns the last images, or None if they are stored.
        """
        self._store = store
        self._messages = messages
        self._project = project
        self._state = state
        self._pictures = pictures
        self._written: tuple[object, ...] = ()  # inputs of the last write
        self._beaten = time.monotonic()
        self._failed = False  # nothing is written until the next beat

    @property
    def is_up_to_date(self) -> bool:
        """True once the whole session is in the store."""
        return not (self._store.is_writing or self._failed) and self._is_same()

    def _is_same(self) -> bool:
        state = self._state()
        return len(state) == len(self._written) and all(map(operator.is_, state, self._written))

    def tick(self, at_rest: bool) -> None:
        """Begin to write changes if no drag is in progress (``at_rest``); call once a frame."""
        self._report()
        if time.monotonic() - self._beaten >= BEAT:
            self._beaten = time.monotonic()
            self._failed = False
            self._store.beat()
            self._keep_pictures()
        if at_rest and not (self._store.is_writing or self._failed or self._is_same()):
            self._written = self._state()
            project = self._project()
            if not project.is_empty:
                self._store.write(project)

    def archive(self) -> None:
        """Make the session an earlier one."""
        self._store.archive(self._project())
        self._written = ()

    def close(self) -> None:
        """Write everything for the next launch, and report an error."""
        self._keep_pictures()
        self._store.close(self._project())
        self._report()

    def _keep_pictures(self) -> None:
        if pictures := self._pictures():
            self._store.keep_pictures(pictures)

    def _report(self) -> None:
        """Report errors of writes and remarks on the database."""
        while self._store.errors:
            self._messages.report("Cannot keep this session", self._store.errors.pop(0))
            self._written = ()
            self._failed = True
        while self._store.notes:
            self._messages.notify(self._store.notes.pop(0), MessageKind.NOTE, buttons=OK)
