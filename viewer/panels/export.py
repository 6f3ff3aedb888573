"""Turntables, pictures and scenes as files."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from imgui_bundle import hello_imgui, icons_fontawesome_4, imgui

from viewer.desk import PICTURES, VIDEOS, Desk, button, tip
from viewer.files import Wish

T = TypeVar("T")
_FILM, _CAMERA = icons_fontawesome_4.ICON_FA_FILM, icons_fontawesome_4.ICON_FA_CAMERA
_SIZES = (128, 256, 384, 512, 768, 1024)
_COUNTS = (36, 72, 144, 288)


class Export:
    """What leaves the window."""

    title = "Export"
    dock = "Lower"

    def __init__(self) -> None:
        self._format = VIDEOS[0]
        self._size = 256
        self._count = 72
        self._picture = 512

    def draw(self, desk: Desk) -> None:
        """Three sections, or a note until there is something to export."""
        if not desk.session.ready:
            imgui.text_disabled("There is something to export once the model is there")
            return
        imgui.separator_text("Turntable")
        self._draw_turntable(desk)
        imgui.separator_text("Picture")
        self._picture = _choice("picture size", self._picture, _SIZES, "{} px", "Width and height of the picture")
        imgui.same_line()
        if button(f"{_CAMERA}  Save picture…###save picture", "The view as a square picture on white"):
            desk.files.ask(Wish("Save the picture as", self._save_picture(desk), PICTURES, True, "picture.png"))
        imgui.separator_text("Scene")
        if button("Save scene…###save scene", "Codes and camera, exact, as a small file (Ctrl+S)"):
            desk.save_scene()
        imgui.same_line()
        if button("Open scene…###open scene", "A scene saved before, of the same model (Ctrl+O)"):
            desk.open_scene()

    def _draw_turntable(self, desk: Desk) -> None:
        exporting = desk.session.exporting
        if exporting.running:
            told = f"{exporting.done} of {exporting.total} frames"
            imgui.progress_bar(exporting.done / exporting.total, (-hello_imgui.em_size(7), 0), told)
            imgui.same_line()
            if button("Cancel###cancel export", "Give it up; no half-written file stays"):
                exporting.cancel()
            return
        self._format = _choice("format", self._format, VIDEOS, "{}", "mp4 is the smallest, gif plays everywhere")
        imgui.same_line()
        self._size = _choice("video size", self._size, _SIZES, "{} px", "Width and height of the video")
        imgui.same_line()
        self._count = _choice("frames", self._count, _COUNTS, "{} frames", "For one turn; 24 are a second")
        if button(f"{_FILM}  Export turntable…###export turntable", "The object turning once round, as a video"):
            name = f"turntable{self._format}"
            desk.files.ask(Wish("Export the turntable as", self._export(desk), VIDEOS, True, name))

    def _export(self, desk: Desk) -> Callable[[Path], None]:
        def answer(path: Path) -> None:
            whole = path if path.suffix else path.with_suffix(self._format)
            desk.session.exporting.turntable(whole, self._count, self._size)

        return answer

    def _save_picture(self, desk: Desk) -> Callable[[Path], None]:
        return lambda path: desk.session.exporting.picture(path, self._picture)


def _choice(name: str, chosen: T, choices: Sequence[T], label: str, text: str) -> T:
    """A drop-down list of few values."""
    imgui.set_next_item_width(hello_imgui.em_size(7))
    if imgui.begin_combo(f"##{name}", label.format(chosen)):
        for value in choices:
            if imgui.selectable(label.format(value), value == chosen)[0]:
                chosen = value
        imgui.end_combo()
    tip(text)
    return chosen
