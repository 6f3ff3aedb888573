"""A signal to any number of receivers."""

from collections.abc import Callable


class Signal:
    """Calls its receivers in the order of connection."""

    def __init__(self) -> None:
        self._receivers: list[Callable[[], object]] = []

    def connect(self, receiver: Callable[[], object]) -> None:
        """Add a receiver, which every :meth:`emit` calls."""
        self._receivers.append(receiver)

    def emit(self) -> None:
        """Call all receivers."""
        for receiver in self._receivers:
            receiver()
