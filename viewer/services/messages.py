"""Messages to the person at the window, including errors."""

import json
import logging
import re
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import datetime
from enum import Enum
from pathlib import Path
from typing import Any, NamedTuple

import torch

from core.runtime.reading import shortened
from viewer.values.printable import printable

_SHOWN = 8.0  # s on screen of a message without buttons
_LONGEST = 400  # characters of a message
_LOGGED = 500  # messages kept in the log
_NO_MEMORY = "can't allocate memory"  # part of torch's RuntimeError when memory is exhausted
_FOLDERS = re.compile(r"(?<![^\s'\"(])(?:[A-Za-z]:|~)?(?:[/\\](?=\S)[^/\\:*?\"<>|\n]+)*[/\\](?=[^\s/\\])")
"""The folders of an absolute path in a text."""
_REASON = re.compile(r"(?<=: not an image that can be read) \(.*\)$|(?<= that can be read) \(file is not a database\)$")
"""A decoder's or a database's words."""
UNFORESEEN = "an error in the program; it is listed in Developer (menu Panels)"


class MessageKind(Enum):
    """Kinds of messages."""

    DONE = "done"  # success
    NOTE = "note"  # to be read
    PROBLEM = "problem"  # an error


class Button(NamedTuple):
    """An action offered by a message; pressing it dismisses the message."""

    label: str
    press: Callable[[], None]
    subject: str = ""  # name of the object it is about, shown after the label


OK = (Button("OK", lambda: None),)  # of a message that stays until it is read


@dataclass(frozen=True)
class Message:
    """One line for the person at the window."""

    text: str
    kind: MessageKind = MessageKind.DONE
    detail: str = ""  # text of an unexpected error, for the log
    buttons: tuple[Button, ...] = ()
    relevant: Callable[[], bool] = lambda: True  # False once the message is out of date
    born: float = field(default_factory=time.monotonic)  # s on the monotonic clock, for fading
    written: datetime = field(default_factory=datetime.now)  # for the log

    @property
    def faded(self) -> bool:
        """True once the message leaves the screen: out of date, or old and without buttons."""
        return not self.relevant() or (not self.buttons and time.monotonic() - self.born > _SHOWN)


class Messages:
    """All messages of a run, of which the newest is on screen."""

    def __init__(self) -> None:
        self.all: list[Message] = []  # those that were not dismissed, the newest last; no two are equal
        self.log: list[Message] = []  # all messages of this run, the oldest first

    @property
    def errors(self) -> list[str]:
        """Texts of errors, even if faded."""
        return [message.text for message in self.all if message.kind is MessageKind.PROBLEM]

    @property
    def newest(self) -> Message | None:
        """The message on screen: the newest until it fades, then one that is still to be read."""
        visible = (message for message in reversed(self.all) if not message.faded)
        return next((message for message in visible if message is self.all[-1] or message.buttons == OK), None)

    def notify(self, text: str, kind: MessageKind = MessageKind.DONE, **more: Any) -> None:
        """Show a message, replacing an equal one; ``more`` are fields of :class:`Message`."""
        text = shortened(" ".join(printable(text).split()), _LONGEST)
        if "detail" in more:
            more["detail"] = printable(more["detail"])
        left = [message for message in self.all if (message.text, message.kind) != (text, kind)]
        message = Message(text, kind, **more)
        self.all = [*left, message][-_LOGGED:]
        self.log = [*self.log, message][-_LOGGED:]

    def report(self, what: str, error: Exception) -> None:
        """Show an error after the words ``what``; log an unexpected one with its traceback."""
        detail = ""
        if not isinstance(error, ValueError | OSError | MemoryError):
            logging.getLogger(__name__).error(what, exc_info=error)
            detail = f"{type(error).__name__}: {error}"
        self.notify(f"{what}: {error_text(error)}", MessageKind.PROBLEM, detail=detail)

    def restart(self) -> None:
        """Show all messages for as long as new ones: the window that shows them has just opened."""
        self.all = [replace(message, born=time.monotonic()) for message in self.all]

    def dismiss(self, message: Message) -> None:
        """Remove a message."""
        self.all = [listed for listed in self.all if listed is not message]


def error_text(error: Exception) -> str:
    """Return an exception's message for a person, without folders and programming terms."""
    text = (printable(error).strip().splitlines() or [""])[0]
    if isinstance(error, MemoryError | torch.OutOfMemoryError) or _NO_MEMORY in text:
        return "not enough memory; try a smaller size"
    if isinstance(error, json.JSONDecodeError | UnicodeError):
        return "the file is damaged, or of another kind"
    if isinstance(error, OSError) and error.strerror:
        name = f"{Path(printable(error.filename)).name}: " if error.filename else ""
        return name + error.strerror[:1].lower() + error.strerror[1:]
    if isinstance(error, ValueError | OSError) and text:
        return _FOLDERS.sub("", _REASON.sub(": it is damaged, or of another kind", text))
    return UNFORESEEN
