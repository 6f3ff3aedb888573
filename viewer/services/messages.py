"""Lines for the person at the window, errors included."""

import logging
import time
from dataclasses import dataclass, field
from enum import Enum

import torch

_SECONDS = 5.0
"""for which information stays"""
_MAX_OLDER = 3
"""lines of information that stay beside a new one, until they fade"""
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
        """Information goes after a while; an error stays until it is dismissed."""
        return self.kind is Kind.INFO and time.monotonic() - self.born > _SECONDS


class Messages:
    """The lines on screen, the newest at the end."""

    def __init__(self) -> None:
        self.all: list[Message] = []

    @property
    def errors(self) -> list[str]:
        """What went wrong and was not dismissed."""
        return [message.text for message in self.all if message.kind is Kind.ERROR]

    def notify(self, text: str, kind: Kind = Kind.INFO) -> None:
        """Show a line, in place of the same one, if that is still there."""
        left = [message for message in self.all if not message.faded and (message.text, message.kind) != (text, kind)]
        older = [message for message in left if message.kind is Kind.INFO][:-_MAX_OLDER]
        self.all = [*(message for message in left if message not in older), Message(text, kind)]

    def report(self, what: str, error: Exception) -> None:
        """Show what went wrong; what nobody foresaw is logged with its trace as well."""
        if not isinstance(error, ValueError | OSError | MemoryError):
            logging.getLogger(__name__).error(what, exc_info=error)
        self.notify(f"{what}: {error_text(error)}", Kind.ERROR)

    def dismiss(self, message: Message) -> None:
        """Take a message away."""
        self.all = [other for other in self.all if other is not message]

    def clear(self) -> None:
        """Take every message away."""
        self.all = []


def error_text(error: Exception) -> str:
    """An exception as a line of text; its type is named where the message alone would not do."""
    text = (str(error).strip().splitlines() or [""])[0]
    if isinstance(error, MemoryError | torch.OutOfMemoryError) or _NO_MEMORY in text:
        return "not enough memory; try a smaller size"
    return text if isinstance(error, ValueError) and text else f"{type(error).__name__}: {text}"
