"""File dialogs of other programs, on Linux: zenity and its like, and kdialog."""

import os
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import IO

from imgui_bundle import hello_imgui

_LIKE_ZENITY = ("zenity", "matedialog", "qarma")
_KDIALOG = "kdialog"
_CANCELLED = 1  # exit status after Cancel, and also after some failures
_QUICK = 1.0  # s within which nobody cancels: a program that has ended by then has failed
_END = 1.0  # s to wait for the end of a killed program
_MOST_OUTPUT = 65_536  # bytes that a program may print; a path is shorter
_HARMLESS = ("warning", "message", "critical")  # words in the lines that toolkits write on stderr


def installed_program() -> str | None:
    """Return the path of a program that shows file dialogs; KDE's where KDE is the desktop."""
    is_kde = "KDE" in os.environ.get("XDG_CURRENT_DESKTOP", "").upper().split(":")
    names = (_KDIALOG, *_LIKE_ZENITY) if is_kde else (*_LIKE_ZENITY, _KDIALOG)
    return next((path for path in map(shutil.which, names) if path), None)


def command(program: str, title: str, start: str, suffixes: Sequence[str], save: bool) -> list[str]:
    """Return the command that shows a dialog.

    Args:
        start: path of the folder, with a separator at its end, or of the proposed file.
    """
    patterns = " ".join(f"*{suffix} *{suffix.upper()}" for suffix in suffixes)
    if Path(program).name == _KDIALOG:
        action = "--getsavefilename" if save else "--getopenfilename"
        return [program, "--title", title, action, start, f"{patterns}|{title}\n*|All files"]
    filters = [f"--file-filter={title} | {patterns}", "--file-filter=All files | *"]
    saving = ["--save", "--confirm-overwrite"] if save else []
    return [program, "--file-selection", f"--title={title}", f"--filename={start}", *filters, *saving]


class ProgramDialog:
    """The dialog of a running program; its end wakes the window. Raises ``OSError`` if it cannot be started."""

    def __init__(self, words: Sequence[str]) -> None:
        self._program = words[0]
        self._began = time.monotonic()
        self._process = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,  # so that its children can be ended with it
        )
        self._answer = ""
        self._errors = ""
        self._seconds = 0.0  # that it was shown
        self._thread = threading.Thread(target=self._wait, name="file dialog", daemon=True)
        self._thread.start()

    def ready(self, timeout: int = 0) -> bool:
        """Wait up to ``timeout`` ms; return True once the program has ended."""
        self._thread.join(timeout / 1000)
        return not self._thread.is_alive()

    def result(self) -> str:
        """Return the chosen path, empty if cancelled. Raises ``OSError`` if the program failed."""
        status = self._process.returncode
        is_cancelled = status in (0, _CANCELLED) and self._seconds > _QUICK and not self._errors
        if is_cancelled or (status == 0 and self._answer):
            return self._answer
        raise OSError(f"{self._program} ended with status {status}: {self._errors}")

    def kill(self) -> None:
        """End the program and its children."""
        self._signal()
        self._thread.join(_END)

    def _signal(self) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def _read(self, stream: IO[bytes]) -> bytes:
        """Return a program's output; one that does not stop is ended."""
        with stream:
            output = stream.read(_MOST_OUTPUT)
            if stream.read(1):
                self._signal()
        return output

    def _wait(self) -> None:
        assert self._process.stdout
        assert self._process.stderr
        with ThreadPoolExecutor(1) as reader:
            reading = reader.submit(self._read, self._process.stderr)
            answer = self._read(self._process.stdout)
            errors = reading.result()
        self._process.wait()
        self._seconds = time.monotonic() - self._began
        self._answer = os.fsdecode(answer).removesuffix("\n")
        lines = errors.decode(errors="replace").splitlines()
        self._errors = "\n".join(line for line in lines if not any(word in line.lower() for word in _HARMLESS)).strip()
        hello_imgui.request_refresh()
