"""Signals that end a program, as an exception, so that what was begun is removed."""

import signal
import sys
import threading
from collections.abc import Callable


def on_termination(end: Callable[[int], None] = lambda number: sys.exit(128 + number)) -> None:
    """Call ``end`` with the number of the signal at SIGTERM and SIGHUP, unless they are ignored (``nohup``).

    Does nothing outside of the main thread, where no handler can be set.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    for name in ("SIGTERM", "SIGHUP"):  # Windows has no SIGHUP
        number = getattr(signal, name, None)
        if number and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda number, _: end(number))
