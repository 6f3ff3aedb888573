"""What panels share: the session, and the window's own things around it."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from imgui_bundle import ImVec2, hello_imgui, imgui

from core.models.pictures import held_scene
from viewer.activities.exporting import Kind
from viewer.autosave import Autosave
from viewer.screen.canvas import Canvas, Images
from viewer.screen.file_dialog import Files, Wish, is_there
from viewer.screen.theme import DARK, LIGHT, Palette
from viewer.services.worker import Job
from viewer.session import Session
from viewer.values.preferences import Preferences

IMAGES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff")
VIDEOS = (".mp4", ".gif", ".webp", ".frames")
SCENES = (".json", ".png")
MESHES = (".glb", ".ply", ".obj")


@dataclass(eq=False)
class Desk:
    """Handed to every panel. Canvas and images are there once the window is."""

    session: Session
    files: Files
    likes: Preferences = field(default_factory=Preferences)
    help_open: bool = False
    canvas: Canvas | None = None
    images: Images | None = None
    focus: str = "Codes"
    """the panel to bring to the front"""
    beside: str = ""
    """another one, of another dock"""
    dragged: str = ""
    """the object that a hand drags to a slot"""
    view: tuple[ImVec2, ImVec2] = (ImVec2(0, 0), ImVec2(0, 0))
    """two corners of the picture on screen"""
    quit: Callable[[], None] = lambda: None
    reset_layout: Callable[[], None] = lambda: None
    autosave: Autosave | None = None
    """none where nothing is kept"""
    _fitting: bool = False

    @property
    def palette(self) -> Palette:
        """The colours of the theme."""
        return DARK if self.likes.dark else LIGHT

    def chose(self, **values: Any) -> None:
        """Take in a preference, by its name."""
        self.likes = replace(self.likes, **values)

    def size_text(self, steps: int) -> None:
        """A larger text, or a smaller one."""
        self.likes = self.likes.sized(self.likes.text * 1.1**steps)

    def fit_image(self) -> None:
        """Ask for an image, and fit it."""
        self.files.ask(Wish("Image to fit", self.fit, IMAGES))

    def fit(self, *paths: Path) -> None:
        """Fit images of one object and show how it goes."""
        self.focus = "Fit"
        for path in paths:
            if path.suffix.lower() in IMAGES:
                self._remember(path)
        self.session.fitting.start(*paths)

    def follow_fit(self) -> None:
        """Bring the race to the front when a fit begins, and the objects, which the result joins, when it ends."""
        if self._fitting != self.session.fitting.running:
            self._fitting = self.session.fitting.running
            self.beside = "Race" if self._fitting else "Objects"

    def paste(self) -> None:
        """Fit the images in the clipboard."""
        session, text = self.session, imgui.get_clipboard_text()

        ended = session.reporting("Cannot paste")
        found = Job("paste", lambda: session.clipboard.images(text), lambda paths: session.fitting.start(*paths), ended)
        session.worker.submit(found)

    def open_scene(self) -> None:
        """Ask for a scene, or a picture that holds one, and open it."""
        self.files.ask(Wish("Scene to open", self.load_scene, SCENES))

    def load_scene(self, path: Path) -> None:
        """Open a scene, or a picture that holds one."""
        self._remember(path)
        self.session.load_scene(path)

    def save_scene(self) -> None:
        """Ask where to, and save the scene."""
        self.files.ask(Wish("Save the scene as", self.session.save_scene, (".json",), True, "scene.json"))

    def drop(self, paths: list[str]) -> None:
        """Take files let go over the window: scenes, and pictures that hold one, are opened; any others are pictures of
        one object, which is fitted.
        """
        self.session.cutting.close()
        others = []
        for path in map(Path, paths):
            if path.suffix.lower() == ".json" or held_scene(path):
                self.load_scene(path)
            else:
                others.append(path)
        if others:
            self.fit(*others)

    def _remember(self, path: Path) -> None:
        if is_there(path):
            self.likes = self.likes.opened(path)


class Panel(Protocol):
    """A dockable window, one subject each."""

    title: str
    dock: str
    """View, Top, Upper, Lower or Strip"""

    def draw(self, desk: Desk) -> None:
        """Draw it; called once a frame, between imgui's begin and end."""


def chord(*keys: imgui.Key) -> int:
    """Keys pressed together, for imgui to ask about. As a number: older Pythons cannot join keys by ``|``."""
    return sum(map(int, keys))


def tip(text: str) -> None:
    """A tooltip for the last item."""
    imgui.set_item_tooltip(text)


def button(label: str, text: str, width: float = 0.0, enabled: bool = True) -> bool:
    """A button (width in em, 0 fits the label) with a tooltip."""
    imgui.begin_disabled(not enabled)
    pressed = imgui.button(label, (hello_imgui.em_size(width) if width else 0, 0))
    imgui.end_disabled()
    tip(text)
    return pressed


def flow(label: str) -> None:
    """Go on in this line where a button of this label has room, else in the next."""
    width = imgui.calc_text_size(label).x + 2 * imgui.get_style().frame_padding.x
    imgui.same_line()
    if imgui.get_content_region_avail().x < width:
        imgui.new_line()


def draw_progress(desk: Desk, kind: Kind) -> bool:
    """How far the file under way is, where it is of this kind."""
    exporting = desk.session.exporting
    if exporting.path is None or exporting.kind != kind:
        return False
    left = exporting.remaining
    told = f"{exporting.path.name}   {exporting.progress:.0%}" + (f"   {left:.0f} s left" if left is not None else "")
    imgui.progress_bar(exporting.progress, (-hello_imgui.em_size(7), 0), told)
    imgui.same_line()
    if button("Cancel###cancel export", "Give it up; no half-written file stays"):
        exporting.cancel()
    return True
