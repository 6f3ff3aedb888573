"""Settings of the whole process that a call changes, and gives back to the caller."""

import os
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from threading import Lock


class SharedContext:
    """A context of the process: the first thread inside enters it, the last one leaves it.

    Threads that each save and restore a setting in turns would lose the caller's.

    Example:
        >>> from contextlib import contextmanager
        >>> @contextmanager
        ... def setting():
        ...     print("on")
        ...     yield
        ...     print("off")
        >>> shared = SharedContext(setting)
        >>> with shared, shared:
        ...     print("inside")
        on
        inside
        off
    """

    def __init__(self, context: Callable[[], AbstractContextManager[object]]) -> None:
        self._context = context
        self._stack = ExitStack()
        self._entries = 0
        self._renew_lock()
        if hasattr(os, "register_at_fork"):  # another thread of the parent may hold the lock
            os.register_at_fork(after_in_child=self._renew_lock)

    def _renew_lock(self) -> None:
        self._lock = Lock()

    def __enter__(self) -> None:
        with self._lock:
            if not self._entries:
                self._stack.enter_context(self._context())
            self._entries += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._entries -= 1
            if not self._entries:
                self._stack.close()
