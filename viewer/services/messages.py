"""What the window has to say, errors included."""

import time
from dataclasses import dataclass, field
from enum import Enum

import torch

_SECONDS = 5.0
_NO_MEMORY = "can't allocate memory"
"""What torch says in a RuntimeError where the processor's memory does not suffice."""


class Kind(Enum):
    """How grave a message is."""

    INFO = "info"
    ERROR = "error"


@dataclass(frozen=True)
class Message:
    """One line for the person at the window."""

    text: str
    kind: Kind = Kind.INFO
    born: float = field(default_factory=time.monotonic)
    """s on the monotonic clock"""

    @property
    def faded(self) -> bool:
        """Information goes by itself; an error stays until it is put away."""
        return self.kind is Kind.INFO and time.monotonic() - self.born > _SECONDS


def explain(error: Exception) -> str:
    """An exception as a line of text; its type is told where the message alone would not do."""
    text = (str(error).strip().splitlines() or [""])[0]
    if isinstance(error, MemoryError | torch.OutOfMemoryError) or _NO_MEMORY in text:
        return "not enough memory; try a smaller size"
    return text if isinstance(error, ValueError) and text else f"{type(error).__name__}: {text}"
