"""Turntables, meshes, images and scenes as files."""

from functools import partial

from imgui_bundle import icons_fontawesome_4, imgui

from core.models.scene import IMAGE_FORMATS
from viewer.context import MESHES, VIDEOS, PanelContext
from viewer.screen.file_dialog import FileRequest
from viewer.widgets.controls import action_button, button, choose, draw_progress
from viewer.widgets.video_form import VideoForm

_VIDEO, _CAMERA = icons_fontawesome_4.ICON_FA_FILM, icons_fontawesome_4.ICON_FA_CAMERA
_CUBE = icons_fontawesome_4.ICON_FA_CUBE
_SIZES = {size: f"{size} px" for size in (128, 256, 384, 512, 768, 1024)}
_COUNTS = {count: f"{count} frames" for count in (36, 72, 144, 288)}
_MESHES = {suffix: suffix for suffix in MESHES}
_IMAGE_HELP = """The object, in colour and in the middle, as a square image on white.
A png holds codes and camera: drop it on the window to bring them back."""
_CELLS: dict[int | None, str] = {None: "auto"} | {cells: f"{cells} cells" for cells in (96, 128, 192, 256, 384, 512)}
_CELLS_HELP = "Along the object: more are finer, and slower. Auto: as many as its detail needs"


class ExportPanel:
    """What can be written to a file."""

    title = "Export"
    dock = "Right"
    folded = True
    waiting = "There is something to export once the model is open"

    def __init__(self) -> None:
        self._video = VideoForm()
        self._count = 72
        self._mesh = MESHES[0]
        self._cells: int | None = None
        self.image_size = 512

    def draw(self, context: PanelContext) -> None:
        """A section for each kind of file."""
        imgui.separator_text("Turntable")
        self._draw_turntable(context)
        imgui.separator_text("Mesh")
        self._draw_mesh(context)
        imgui.separator_text("Image")
        self.image_size = choose("image size", self.image_size, _SIZES, "Width and height of the image")
        imgui.same_line()
        if button(f"{_CAMERA}  Save image…###save image", _IMAGE_HELP):
            save = partial(context.exporting.image, size=self.image_size)
            context.ask(FileRequest("Save the image as", save, IMAGE_FORMATS, True, "image.png"))
        imgui.separator_text("Scene")
        action_button(context, "save_scene")
        imgui.same_line()
        action_button(context, "open_scene")

    def _draw_turntable(self, context: PanelContext) -> None:
        if draw_progress(context, "turntable"):
            return
        self._video.draw()
        self._count = choose("frames", self._count, _COUNTS, "For one turn")
        imgui.same_line()
        idle = not context.exporting.running
        about = "The object turning once round, as a video"
        if button(f"{_VIDEO}  Export turntable…###export turntable", about, enabled=idle):
            export = partial(context.exporting.turntable, frames=self._count, options=self._video.options)
            context.ask(FileRequest("Export the turntable as", export, VIDEOS, True, f"turntable{self._video.suffix}"))

    def _draw_mesh(self, context: PanelContext) -> None:
        if draw_progress(context, "mesh"):
            return
        self._mesh = choose("mesh format", self._mesh, _MESHES, "glb opens in most programs")
        imgui.same_line()
        self._cells = choose("cells", self._cells, _CELLS, _CELLS_HELP)
        idle = not context.exporting.running
        about = "The object as a closed surface with coloured vertices"
        if button(f"{_CUBE}  Export mesh…###export mesh", about, enabled=idle):
            export = partial(context.exporting.mesh, resolution=self._cells)
            context.ask(FileRequest("Export the mesh as", export, MESHES, True, f"mesh{self._mesh}"))
