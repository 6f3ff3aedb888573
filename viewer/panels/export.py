"""Turntables, meshes, pictures and scenes as files."""

from functools import partial

from imgui_bundle import icons_fontawesome_4, imgui

from core.models.pictures import FORMATS
from viewer.context import MESHES, VIDEOS, Desk, button, draw_progress
from viewer.screen.file_dialog import Wish
from viewer.widgets.video_form import VideoForm, choose

_FILM, _CAMERA = icons_fontawesome_4.ICON_FA_FILM, icons_fontawesome_4.ICON_FA_CAMERA
_CUBE = icons_fontawesome_4.ICON_FA_CUBE
_SIZES = {size: f"{size} px" for size in (128, 256, 384, 512, 768, 1024)}
_COUNTS = {count: f"{count} frames" for count in (36, 72, 144, 288)}
_MESHES = {suffix: suffix for suffix in MESHES}
_PICTURE_HELP = """The object, in colour and in the middle, as a square picture on white.
A png holds codes and camera: drop it on the window to bring them back."""
_CELLS: dict[int | None, str] = {None: "auto"} | {cells: f"{cells} cells" for cells in (96, 128, 192, 256, 384, 512)}
_CELLS_HELP = "Along the object: more are finer, and slower. Auto: as many as its detail asks for"


class Export:
    """What leaves the window."""

    title = "Export"
    dock = "Lower"

    def __init__(self) -> None:
        self._video = VideoForm()
        self._count = 72
        self._mesh = MESHES[0]
        self._cells: int | None = None
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
        self._picture = choose("picture size", self._picture, _SIZES, "Width and height of the picture")
        imgui.same_line()
        if button(
            f"{_CAMERA}  Save picture…###save picture",
            _PICTURE_HELP,
        ):
            save = partial(desk.session.exporting.picture, size=self._picture)
            desk.files.ask(Wish("Save the picture as", save, FORMATS, True, "picture.png"))
        imgui.separator_text("Scene")
        if button("Save scene…###save scene", "Codes and camera, exact, as a small file (Ctrl+S)"):
            desk.save_scene()
        imgui.same_line()
        if button("Open scene…###open scene", "A scene or picture saved before, of the same model (Ctrl+O)"):
            desk.open_scene()

    def _draw_turntable(self, desk: Desk) -> None:
        if draw_progress(desk, "turntable"):
            return
        self._video.draw()
        self._count = choose("frames", self._count, _COUNTS, "For one turn")
        imgui.same_line()
        idle = not desk.session.exporting.running
        about = "The object turning once round, as a video"
        if button(f"{_FILM}  Export turntable…###export turntable", about, enabled=idle):
            export = partial(desk.session.exporting.turntable, frames=self._count, choice=self._video.choice)
            desk.files.ask(Wish("Export the turntable as", export, VIDEOS, True, f"turntable{self._video.suffix}"))

    def _draw_mesh(self, desk: Desk) -> None:
        if draw_progress(desk, "mesh"):
            return
        self._mesh = choose("mesh format", self._mesh, _MESHES, "glb opens in most programs")
        imgui.same_line()
        self._cells = choose("cells", self._cells, _CELLS, _CELLS_HELP)
        idle = not desk.session.exporting.running
        about = "The object as a closed surface with coloured vertices"
        if button(f"{_CUBE}  Export mesh…###export mesh", about, enabled=idle):
            export = partial(desk.session.exporting.mesh, resolution=self._cells)
            desk.files.ask(Wish("Export the mesh as", export, MESHES, True, f"mesh{self._mesh}"))
