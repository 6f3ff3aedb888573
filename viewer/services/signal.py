"""A signal to any number of receivers."""

from collections.abc import Callable
from typing import Generic, ParamSpec

P = ParamSpec("P")


class Signal(Generic[P]):
    """Calls its receivers in the order of connection."""

    def __init__(self) -> None:
        self._receivers: list[Callable[P, object]] = []

    def connect(self, receiver: Callable[P, object]) -> None:
        """Add a receiver, which every :meth:`emit` calls."""
        self._receivers.append(receiver)

    def emit(self, *args: P.args, **kwargs: P.kwargs) -> None:
        """Call all receivers with these arguments."""
        for receiver in self._receivers:
            receiver(*args, **kwargs)
