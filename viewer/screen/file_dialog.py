"""Asking for a file: the system's own dialog where there is one, else a line to type in."""

import shutil
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from imgui_bundle import hello_imgui, imgui
from imgui_bundle import portable_file_dialogs as dialogs

_TITLE = "Choose a file###ask"


@dataclass(frozen=True, eq=False)
class Wish:
    """A file to be chosen."""

    title: str
    answer: Callable[[Path], None]
    suffixes: tuple[str, ...]
    save: bool = False
    name: str = ""
    """proposed"""

    def path(self, typed: str) -> Path:
        """Where an answer leads; a file to save that has no ending gets the proposed one's."""
        path = Path(typed.strip())
        with suppress(RuntimeError):  # a home of nobody
            path = path.expanduser()
        return Path(f"{path}{Path(self.name).suffix}") if self.save and not path.suffix else path


def is_there(path: Path) -> bool:
    """Whether a file is there and can be told to be."""
    with suppress(OSError, ValueError):
        return path.is_file()
    return False


def has_native() -> bool:
    """Whether the system has a file dialog that can be started."""
    return sys.platform != "linux" or any(map(shutil.which, ("zenity", "kdialog", "matedialog", "qarma")))


class Files:
    """One question at a time; nothing waits for the answer."""

    def __init__(self, native: bool | None = None) -> None:
        self._native = has_native() if native is None else native
        self._wish: Wish | None = None
        self._dialog: dialogs.open_file | dialogs.save_file | None = None
        self._text = ""
        self._fresh = False
        self.folder = Path.home()
        """where the last answer was"""

    @property
    def asking(self) -> bool:
        """A question is open."""
        return self._wish is not None

    def ask(self, wish: Wish) -> None:
        """Put a question, unless one is open."""
        if self._wish:
            return
        self._wish = wish
        if self._native:
            self._dialog = _open_native(wish, self.folder)
        else:
            self._text, self._fresh = str(self.folder / wish.name), True

    def draw(self) -> None:
        """Look for the native answer, or draw the line to type in; to be called once a frame."""
        if self._wish is None:
            return
        if self._dialog is None:
            self._draw_line(self._wish)
        elif self._dialog.ready(0):
            result = self._dialog.result()
            self._answered(self._wish, result if isinstance(result, str) else next(iter(result), ""))

    def _answered(self, wish: Wish, answer: str) -> None:
        """The system has asked about the name that was typed, not about the one that an ending makes of it."""
        path = wish.path(answer)
        if wish.save and answer and path != Path(answer) and is_there(path):
            self._dialog = _open_native(replace(wish, name=path.name), path.parent)
        else:
            self._close(answer)

    def _draw_line(self, wish: Wish) -> None:
        if self._fresh:
            imgui.open_popup(_TITLE)
        imgui.set_next_window_pos(imgui.get_main_viewport().get_center(), imgui.Cond_.always, (0.5, 0.5))
        imgui.set_next_window_size((hello_imgui.em_size(36), 0))
        if not imgui.begin_popup_modal(_TITLE, None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        imgui.text(wish.title)
        if self._fresh:
            imgui.set_keyboard_focus_here()
            self._fresh = False
        imgui.set_next_item_width(-1)
        entered, self._text = imgui.input_text("##path", self._text, imgui.InputTextFlags_.enter_returns_true)
        imgui.text_disabled(self._verdict(wish))
        size = hello_imgui.em_to_vec2(6, 0)
        chosen = imgui.button("Save###choose" if wish.save else "Open###choose", size) or entered
        imgui.same_line()
        cancelled = imgui.button("Cancel", size) or imgui.is_key_pressed(imgui.Key.escape)
        if chosen or cancelled:
            imgui.close_current_popup()
        imgui.end_popup()
        if chosen or cancelled:
            self._close(self._text.strip() if chosen else "")

    def _verdict(self, wish: Wish) -> str:
        path = wish.path(self._text)
        if wish.save:
            return "The file is there and will be replaced" if is_there(path) else " / ".join(wish.suffixes)
        return " / ".join(wish.suffixes) if is_there(path) else "Type the path of a file"

    def _close(self, answer: str) -> None:
        wish, self._wish, self._dialog = self._wish, None, None
        if wish and answer:
            path = wish.path(answer)
            self.folder = path.parent
            wish.answer(path)


def _open_native(wish: Wish, folder: Path) -> dialogs.open_file | dialogs.save_file:
    filters = [wish.title, " ".join(f"*{suffix}" for suffix in wish.suffixes), "All files", "*"]
    if wish.save:
        return dialogs.save_file(wish.title, str(folder / wish.name), filters)
    return dialogs.open_file(wish.title, str(folder), filters)
