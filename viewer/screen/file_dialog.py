"""The choice of a file in the system's dialog or, without one, by typing its path."""

import os
import re
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, count
from pathlib import Path
from typing import Protocol, runtime_checkable

from imgui_bundle import hello_imgui, imgui
from imgui_bundle import portable_file_dialogs as dialogs

from core.fitting.problem import MOST_PHOTOS
from core.photos.decode import IMAGE_SUFFIXES
from viewer.screen.dialog_programs import ProgramDialog, command, installed_program
from viewer.values.printable import as_label, printable

_TITLE = "Choose a file###ask"
_WAITING = "Waiting for the file dialog###waiting"
_HEIGHT, _MOST = 14, 300  # em, height of the list of files; most files in it
_NOT_LISTED = re.compile("^[.]|[\ud800-\udfff]")  # hidden files, and names that no text holds
_PATIENCE = 3.0  # s after which a dialog of the system may be hidden or hang


@runtime_checkable
class NativeDialog(Protocol):
    """An open file dialog of the system."""

    def ready(self, timeout: int = ...) -> bool:
        """Wait up to ``timeout`` ms; return True once a person has answered."""

    def result(self) -> str | list[str]:
        """Return the chosen path or paths, empty if cancelled. Raises ``OSError`` if the dialog failed."""

    def kill(self) -> object:
        """Close the dialog."""


@dataclass(frozen=True, eq=False)
class FileRequest:
    """A request for a file to open or save."""

    title: str
    answer: Callable[..., None]  # called with the chosen path or paths
    suffixes: tuple[str, ...]  # endings of the files to choose from
    save: bool = False
    name: str = ""  # proposed file name
    several: bool = False  # several files can be chosen where their paths are typed

    def path(self, typed: str) -> Path:
        """Return typed text as a path; a file to save gets the proposed ending if it has none."""
        path = _expanded(typed)
        return Path(f"{path}{Path(self.name).suffix}") if self.save and not path.suffix else path

    def start(self, folder: Path) -> str:
        """Return the path to begin with: of the proposed file, or of the folder with a separator."""
        return f"{folder / self.name}{'' if self.name else os.sep}"


def _expanded(typed: str) -> Path:
    """Return typed text as a path, with ~ as the home of a known user."""
    path = Path(typed.strip())
    with suppress(RuntimeError):
        return path.expanduser()
    return path


def is_there(path: Path, test: Callable[[Path], bool] = Path.is_file) -> bool:
    """True if a path is accessible and passes a test: by default, that it is a file."""
    with suppress(OSError, ValueError):
        return test(path)
    return False


def listed(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Return a folder's folders and its files of some endings, the newest first; none of a folder that is not there."""
    dated = list[tuple[float, Path]]()
    with suppress(OSError, ValueError):
        for path in folder.iterdir():
            if _NOT_LISTED.search(path.name) is None and (path.suffix.lower() in suffixes or path.is_dir()):
                dated.append((path.stat().st_mtime, path))
    return [path for _, path in sorted(dated, reverse=True)[:_MOST]]


def _downloads() -> Path:
    """Return the user's folder of downloads, where photos come from; without one the home, or the current folder."""
    folders = _expanded("~/Downloads"), _expanded("~")
    return next((folder for folder in folders if is_there(folder, Path.is_dir)), Path.cwd())


def has_native() -> bool:
    """True if the system has a file dialog; on Linux, if a program that shows one is installed."""
    return sys.platform != "linux" or installed_program() is not None


class FileDialog:
    """Asks for one file at a time, without blocking.

    If the system's dialog fails, a path can be typed; likewise if a file is asked for again while it is open.
    """

    def __init__(self, native: bool | None = None, open_native: Callable[..., NativeDialog] | None = None) -> None:
        """Use the system's dialog if there is one; ``native`` and ``open_native`` override it, for tests."""
        self._native = has_native() if native is None else native
        self._open_native = open_native or _open_native
        self._request: FileRequest | None = None
        self._dialog: NativeDialog | None = None
        self._opened = 0.0  # s on the monotonic clock, when the system's dialog was opened
        self._text = ""  # of the input line
        self._fresh = False  # the input line opens in the next frame
        self._to_replace: Path | None = None  # existing file that "Replace" confirms
        self._list: tuple[Path, list[Path]] | None = None  # a folder, and its folders and files to choose from
        self._chosen: list[Path] = []  # files chosen with Ctrl, in the order of the clicks
        self.folder = _downloads()  # of the last opened file
        self.saves = self.folder  # of the last saved file

    def save_in(self, folder: str) -> None:
        """Save in the folder of an earlier launch, if it is still there."""
        if folder and is_there(Path(folder), Path.is_dir):
            self.saves = Path(folder)

    def unused(self, name: str) -> Path:
        """Return the path of a new file beside the last saved one, numbered if the name is taken."""
        path = self.saves / name
        numbered = (path.with_stem(f"{path.stem}-{number}") for number in count(2))
        return next(free for free in chain([path], numbered) if not is_there(free, Path.exists))

    @property
    def asking(self) -> bool:
        """True while a request is open."""
        return self._request is not None

    def ask(self, request: FileRequest) -> None:
        """Open a request. While a path is typed it is ignored; it ends a dialog of the system, which may hang."""
        if self._request and not self._dialog:
            return
        again = self._request is not None
        self.close()
        self._request = request
        folder = self.saves if request.save else self.folder
        if self._native and not again:
            self._show_native(request, folder)
        else:
            self._show_line(request, folder)

    def close(self) -> None:
        """End the request without an answer, and a dialog of the system."""
        if self._dialog:
            self._dialog.kill()
        self._dialog = self._request = None

    def _show_native(self, request: FileRequest, folder: Path) -> None:
        """Open the system's dialog, or the input line if it cannot be started."""
        self._opened = time.monotonic()
        try:
            self._dialog = self._open_native(request, folder)
        except OSError:
            self._show_line(request, folder)

    def _show_line(self, request: FileRequest, folder: Path) -> None:
        self._dialog = None
        self._text = printable(request.start(folder))
        self._fresh = True
        self._to_replace = self._list = None
        self._chosen = []

    def draw(self) -> None:
        """Poll the native dialog or draw the input line; call once a frame."""
        if self._request is None:
            return
        if self._dialog is None:
            self._draw_line(self._request)
        elif self._dialog.ready(0):
            try:
                result = self._dialog.result()
            except OSError:
                self._show_line(self._request, self.saves if self._request.save else self.folder)
            else:
                self._answered(self._request, result if isinstance(result, str) else next(iter(result), ""))
        else:
            self._draw_waiting(self._request)

    def _draw_waiting(self, request: FileRequest) -> None:
        """Offer to do without the system's dialog once it has been open for a while: it may hang or be hidden."""
        if imgui.is_key_pressed(imgui.Key.escape):
            self.close()
        elif time.monotonic() - self._opened > _PATIENCE:
            imgui.set_next_window_pos(imgui.get_main_viewport().get_center(), imgui.Cond_.always, (0.5, 0.5))
            flags = imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.always_auto_resize
            if imgui.begin(_WAITING, None, flags | imgui.WindowFlags_.no_collapse | imgui.WindowFlags_.no_docking)[0]:
                imgui.text("A window of another program asks for the file.")
                if imgui.button("Type its path"):
                    self.ask(request)
                imgui.same_line()
                if imgui.button("Cancel"):
                    self.close()
            imgui.end()

    def _answered(self, request: FileRequest, answer: str) -> None:
        """Handle an answer of the system's dialog.

        Ask again if the added ending makes it an existing file, as the system has not asked about replacing that.
        """
        path = request.path(answer)
        if request.save and answer and path != Path(answer) and is_there(path):
            self._show_native(replace(request, name=path.name), path.parent)
        else:
            self._close(*[path] if answer else [])

    def _draw_line(self, request: FileRequest) -> None:
        if self._fresh:
            imgui.open_popup(_TITLE)
        viewport = imgui.get_main_viewport()
        imgui.set_next_window_pos(viewport.get_center(), imgui.Cond_.always, (0.5, 0.5))
        imgui.set_next_window_size((min(hello_imgui.em_size(36), 0.94 * viewport.work_size.x), 0))
        if not imgui.begin_popup_modal(_TITLE, None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        imgui.text(request.title)
        if self._fresh:
            imgui.set_keyboard_focus_here()
            self._fresh = False
        imgui.set_next_item_width(-1)
        entered, text = imgui.input_text("##path", self._text, imgui.InputTextFlags_.enter_returns_true)
        self._chosen = self._chosen if text == self._text else []
        self._text = text
        imgui.text_disabled(self._verdict(request))
        entered |= self._draw_list(request)
        photos = self._photos_of_folder(request)
        path = request.path(self._text)
        files = f" its {len(photos)} photos" if photos else f" {len(self._chosen)} files" if self._chosen else ""
        label = f"Open{files}" if not request.save else "Replace" if self._to_replace == path else "Save"
        pressed = imgui.button(f"{label}###choose", hello_imgui.em_to_vec2(0 if files else 6, 0))
        accepted = photos if pressed and photos else self._accepted(request) if pressed or entered else []
        if entered and not accepted and (state := imgui.internal.get_input_text_state(imgui.get_id("##path"))):
            imgui.internal.set_active_id(state.id_, imgui.internal.get_current_window())  # no key typed now is lost
            state.reload_user_buf_and_move_to_end()
        imgui.same_line()
        cancelled = imgui.button("Cancel", hello_imgui.em_to_vec2(6, 0)) or imgui.is_key_pressed(imgui.Key.escape)
        if accepted or cancelled:
            imgui.close_current_popup()
        imgui.end_popup()
        if accepted or cancelled:
            self._close(*accepted)

    def _photos_of_folder(self, request: FileRequest) -> list[Path]:
        """Return the photos of an entered folder, which open together; none if they are more than a fit takes."""
        if self._list is None or self._chosen or not request.several or self._list[0] != _expanded(self._text):
            return []
        photos = sorted(path for path in self._list[1] if path.suffix.lower() in IMAGE_SUFFIXES)
        return photos if len(photos) <= MOST_PHOTOS else []

    def _accepted(self, request: FileRequest) -> list[Path]:
        """Return the files that Enter opens or saves; none if it enters a folder, or asks before it replaces a file."""
        path = request.path(self._text)
        if self._chosen:
            return self._chosen
        # A format without an ending is a folder of frames.
        if is_there(folder := _expanded(self._text), Path.is_dir) and (not request.save or Path(request.name).suffix):
            self._text = printable(request.start(folder))
            return []
        if request.save and path != self._to_replace and is_there(path):
            self._to_replace = path
            return []
        return [path] if request.save or is_there(path) else []

    def _draw_list(self, request: FileRequest) -> bool:
        """Draw the folder of the typed path, the newest first. Return whether a file was opened there.

        A double click or Enter opens a file or a folder; a click chooses it, and with Ctrl another file.
        """
        typed = _expanded(self._text)
        folder = typed if self._text.endswith(os.sep) else typed.parent
        if self._list is None or self._list[0] != folder:
            self._list = folder, listed(folder, request.suffixes)
        is_opened = False
        if imgui.begin_child("files", (0, hello_imgui.em_size(_HEIGHT)), imgui.ChildFlags_.borders):
            flags = imgui.SelectableFlags_.allow_double_click | imgui.SelectableFlags_.no_auto_close_popups
            for number, path in enumerate((folder.parent, *self._list[1])):
                is_folder = not number or path.is_dir()
                label = ".." if not number else f"{path.name}{os.sep if is_folder else ''}"
                is_chosen = path == typed or path in self._chosen
                if imgui.selectable(f"{as_label(printable(label))}###file {number}", is_chosen, flags)[0]:
                    opens = imgui.is_mouse_double_clicked(0) or not imgui.is_mouse_released(0)  # or by the keyboard
                    if request.several and imgui.get_io().key_ctrl and not is_folder:
                        files = self._chosen or list(filter(is_there, [typed]))
                        left = [file for file in files if file != path]
                        self._chosen = left if path in files and left else [*left, path]
                        self._text = str(self._chosen[-1])
                    elif opens or number:
                        self._chosen = []
                        self._text = f"{path}{os.sep if is_folder and opens else ''}"
                        is_opened |= opens and not is_folder
        imgui.end_child()
        return is_opened

    def _verdict(self, request: FileRequest) -> str:
        path = request.path(self._text)
        if request.save and is_there(path):
            return f"Replace {path.name}?" if path == self._to_replace else f"{path.name} is there"
        if request.save:
            return " / ".join(request.suffixes) if is_there(path.parent, Path.is_dir) else "No such folder"
        if is_there(path, Path.is_dir):
            return "Choose a file, or several with Ctrl" if request.several else "Choose a file, or type its path"
        return "" if is_there(path) else "No such file"

    def _close(self, *paths: Path) -> None:
        request = self._request
        self._request = None
        self._dialog = None
        if request and paths:
            if request.save:
                self.saves = paths[0].parent
            else:
                self.folder = paths[0].parent
            request.answer(*paths)


def _open_native(request: FileRequest, folder: Path) -> NativeDialog:
    """Open the system's dialog. Raises ``OSError`` if it cannot be started."""
    if program := installed_program():
        start = request.start(folder)
        return ProgramDialog(command(program, request.title, start, request.suffixes, request.save))
    filters = [request.title, " ".join(f"*{suffix}" for suffix in request.suffixes), "All files", "*"]
    if request.save:
        return dialogs.save_file(request.title, str(folder / request.name), filters)
    return dialogs.open_file(request.title, str(folder), filters)
