"""Output of commands to terminals, pipes and logs that may end before the command does."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import IO, Any, cast

from core.runtime.program import program_name

_collected = ContextVar[list[str] | None]("collected", default=None)  # of each thread


class LastingOutput:
    """A text stream that outlives its reader: a failed write is reported once on stderr, later text is dropped."""

    def __init__(self, stream: IO[str], name: str) -> None:
        self._stream = stream
        self._name = name
        self.error: OSError | None = None  # of the first failed write

    def __getattr__(self, attribute: str) -> Any:
        return getattr(self._stream, attribute)

    def write(self, text: str) -> int:
        """Write text; return its length."""
        self._attempt(lambda: self._stream.write(text))
        return len(text)

    def flush(self) -> None:
        """Pass buffered text on."""
        self._attempt(self._stream.flush)

    def _attempt(self, act: Callable[[], object]) -> None:
        try:
            act()
        except OSError as error:
            if self.error is None:
                self.error = error
                _discard(self._stream)
                say(f"{self._name} cannot be written any more ({error.strerror}); the work goes on")


@contextmanager
def lasting_output() -> Iterator[None]:
    """Let the standard streams outlive their readers.

    Exits with status 1 at the end if standard output was lost otherwise than by a reader that left, as on a full disk.
    """
    output = LastingOutput(sys.stdout or _nowhere(), "standard output")
    errors = LastingOutput(sys.stderr or _nowhere(), "standard error")
    with redirect_stdout(cast("IO[str]", output)), redirect_stderr(cast("IO[str]", errors)):
        try:
            yield
        finally:
            output.flush()
            errors.flush()
        if output.error and not isinstance(output.error, BrokenPipeError):
            sys.exit(1)


def say(text: str) -> None:
    """Print a line to people, on stderr; inside :func:`collected_lines` collect it instead."""
    lines = _collected.get()
    if lines is None:
        print(f"{program_name('core', 'codenerf')}: {text}", file=sys.stderr)
    else:
        lines.append(text)


@contextmanager
def collected_lines() -> Iterator[list[str]]:
    """Collect the lines of :func:`say` in this thread, and hide its progress bars."""
    lines = list[str]()
    token = _collected.set(lines)
    try:
        yield lines
    finally:
        _collected.reset(token)


def bars_disabled() -> bool | None:
    """Return tqdm's ``disable``: True inside :func:`collected_lines`, None to show bars on terminals only."""
    return None if _collected.get() is None else True


def _nowhere() -> IO[str]:
    """Open a sink in place of a closed stream, so that no file gets its number."""
    return Path(os.devnull).open("w")


def _discard(stream: IO[str]) -> None:
    """Lead a stream to nowhere, so that its buffered text does not fail again when the stream closes."""
    with suppress(OSError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
