"""Termination signals as exceptions, so that unfinished results are removed."""

import signal
import sys
import threading
from collections.abc import Callable, Sequence

TERMINATION = "SIGTERM", "SIGHUP"  # Windows has no SIGHUP


def on_signals(
    end: Callable[[int], object] = lambda number: sys.exit(128 + number), names: Sequence[str] = TERMINATION
) -> None:
    """Call ``end`` with the number of an arriving signal, by default to exit.

    Signals that the process ignores (``nohup``) stay ignored.

    Does nothing outside the main thread, where no handler can be set.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    for name in names:
        number = getattr(signal, name, None)
        if number and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda number, _: end(number))
