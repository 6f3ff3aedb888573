"""Turntables, meshes, pictures and scenes as files."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from imgui_bundle import hello_imgui, icons_fontawesome_4, imgui

from viewer.desk import MESHES, PICTURES, VIDEOS, Desk, button, draw_progress, tip
from viewer.files import Wish

T = TypeVar("T")
_FILM, _CAMERA = icons_fontawesome_4.ICON_FA_FILM, icons_fontawesome_4.ICON_FA_CAMERA
_CUBE = icons_fontawesome_4.ICON_FA_CUBE
_SIZES = (128, 256, 384, 512, 768, 1024)
_COUNTS = (36, 72, 144, 288)
_PICTURE_HELP = """The view as a square picture on white.
A png holds codes and camera: drop it on the window to bring them back."""
_CELLS = (96, 128, 192, 256, 384, 512)


class Export:
    """What leaves the window."""

    title = "Export"
    dock = "Lower"

    def __init__(self) -> None:
        self._video = VIDEOS[0]
        self._size = 256
        self._count = 72
        self._mesh = MESHES[0]
        self._cells = 256
        self._picture = 512

    def draw(self, desk: Desk) -> None:
        """A section for each kind of file, or a note until there is something to export."""
        if not desk.session.ready:
            imgui.text_disabled("There is something to export once the model is there")
            return
        imgui.separator_text("Turntable")
        self._draw_turntable(desk)
        imgui.separator_text("Mesh")
        self._draw_mesh(desk)
        imgui.separator_text("Picture")
        self._picture = _choice("picture size", self._picture, _SIZES, "{} px", "Width and height of the picture")
        imgui.same_line()
        if button(
            f"{_CAMERA}  Save picture…###save picture",
            _PICTURE_HELP,
        ):
            desk.files.ask(Wish("Save the picture as", self._save_picture(desk), PICTURES, True, "picture.png"))
        imgui.separator_text("Scene")
        if button("Save scene…###save scene", "Codes and camera, exact, as a small file (Ctrl+S)"):
            desk.save_scene()
        imgui.same_line()
        if button("Open scene…###open scene", "A scene or picture saved before, of the same model (Ctrl+O)"):
            desk.open_scene()

    def _draw_turntable(self, desk: Desk) -> None:
        if draw_progress(desk, "turntable"):
            return
        self._video = _choice("format", self._video, VIDEOS, "{}", "mp4 is the smallest, gif plays everywhere")
        imgui.same_line()
        self._size = _choice("video size", self._size, _SIZES, "{} px", "Width and height of the video")
        imgui.same_line()
        self._count = _choice("frames", self._count, _COUNTS, "{} frames", "For one turn; 24 are a second")
        idle = not desk.session.exporting.running
        about = "The object turning once round, as a video"
        if button(f"{_FILM}  Export turntable…###export turntable", about, enabled=idle):
            name = f"turntable{self._video}"
            desk.files.ask(Wish("Export the turntable as", self._export_turntable(desk), VIDEOS, True, name))

    def _draw_mesh(self, desk: Desk) -> None:
        if draw_progress(desk, "mesh"):
            return
        self._mesh = _choice("mesh format", self._mesh, MESHES, "{}", "glb opens in most programs")
        imgui.same_line()
        self._cells = _choice("cells", self._cells, _CELLS, "{} cells", "Along the object: more are finer, and slower")
        idle = not desk.session.exporting.running
        about = "The object as a closed surface with coloured vertices"
        if button(f"{_CUBE}  Export mesh…###export mesh", about, enabled=idle):
            name = f"mesh{self._mesh}"
            desk.files.ask(Wish("Export the mesh as", self._export_mesh(desk), MESHES, True, name))

    def _export_turntable(self, desk: Desk) -> Callable[[Path], None]:
        video, count, size = self._video, self._count, self._size
        return lambda path: desk.session.exporting.turntable(_named(path, video), count, size)

    def _export_mesh(self, desk: Desk) -> Callable[[Path], None]:
        mesh, cells = self._mesh, self._cells
        return lambda path: desk.session.exporting.mesh(_named(path, mesh), cells)

    def _save_picture(self, desk: Desk) -> Callable[[Path], None]:
        return lambda path: desk.session.exporting.picture(path, self._picture)


def _named(path: Path, suffix: str) -> Path:
    """A name typed without an ending gets the chosen one."""
    return path if path.suffix else path.with_suffix(suffix)


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
