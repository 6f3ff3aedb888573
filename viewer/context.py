"""The context of panels: the session, the window's own state, and actions on both."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from imgui_bundle import ImVec2, imgui

from core.detail.progressive import Frame
from core.models.scene import embedded_scene
from core.photos.clip import VIDEO_SUFFIXES
from core.photos.decode import IMAGE_SUFFIXES, image_files
from viewer.screen.canvas import Canvas, Images
from viewer.screen.file_dialog import FileDialog, FileRequest, is_there
from viewer.screen.theme import DARK, LIGHT, Palette
from viewer.services.clipboard import Clipboard, copy_image
from viewer.services.file_manager import show_in_folder
from viewer.services.messages import MessageKind
from viewer.services.worker import Job
from viewer.session import Session
from viewer.values.fit_history import Question
from viewer.values.preferences import Preferences
from viewer.values.printable import file_name
from viewer.values.project import SUFFIX

PROJECTS = (SUFFIX,)  # endings of project files
MODELS = (".safetensors", ".pth", ".pt")  # endings of model files


@dataclass
class Hints:
    """Drawings over the object in the view's next frame, for panels with something under the mouse."""

    ring: tuple[float, ...] = ()  # azimuths of photos, rad, for a ring on the ground
    shows_size: bool = False  # a box around the object
    overlay: np.ndarray | None = None  # square RGBA pixels


@dataclass(eq=False)
class PanelContext:
    """The context that every panel is drawn with. Canvases, images and fonts exist once the window does."""

    session: Session
    files: FileDialog
    preferences: Preferences = field(default_factory=Preferences)
    help_open: bool = False
    share_open: bool = False
    canvas: Canvas | None = None
    fast_opengl: bool = False  # OpenGL is fast enough for a baked object, measured at start
    images: Images | None = None
    bold: imgui.ImFont | None = None  # for headings
    focus: str = ""  # title of the panel to bring to the front; empty for none
    tool: str = "turn"  # use of a drag in the view: turn, size, or a tool of :class:`viewer.panels.view.ViewPanel`
    dragged: str = ""  # name of the object that is dragged onto B
    view: tuple[ImVec2, ImVec2] = (ImVec2(0, 0), ImVec2(0, 0))  # upper left and lower right corner of the view, px
    covered: float = 0.0  # px of the view's lower edge that the history covers
    card_width: float = 0.0  # px of the view's lower edge, from the right, that the welcome card takes from the history
    hints: Hints = field(default_factory=Hints)
    quit: Callable[[], None] = lambda: None
    reset_layout: Callable[[], None] = lambda: None
    fold_panels: Callable[[], None] = lambda: None
    panels: tuple[str, ...] = ()  # titles of all panels
    clipboard: Clipboard = field(default_factory=Clipboard)
    file_manager: Callable[[Path], None] = show_in_folder

    # Preferences

    @property
    def palette(self) -> Palette:
        """The colours of the theme."""
        return DARK if self.preferences.dark else LIGHT

    def texture(self, image: Frame | np.ndarray) -> imgui.ImTextureRef:
        """Return the texture of a frame on the theme's background, or of uint8 RGB or RGBA pixels."""
        assert self.images is not None, "no window yet"
        return self.images.texture(image, self.palette)

    def set_preference(self, **values: Any) -> None:
        """Change preferences by name."""
        self.preferences = replace(self.preferences, **values)

    def resize_text(self, steps: int) -> None:
        """Enlarge the text by steps of 10 %; negative steps make it smaller."""
        self.preferences = self.preferences.with_text_size(self.preferences.text * 1.1**steps)

    def see_photo(self) -> None:
        """Turn the view to the photo's camera and switch the tool that wipes the photo."""
        wiped = self.tool == "wipe" and self.session.photo_camera == self.session.editor.scene.camera
        self.tool = "turn" if wiped else "wipe"
        self.session.see_from("photo")

    def copy_image(self) -> None:
        """Copy the view's image to the clipboard, on white and without the shadow."""
        assert self.session.viewport.frame is not None, "nothing is shown yet"
        try:
            copy_image(self.session.viewport.frame.image)
        except ValueError as error:
            self.session.messages.report("Cannot copy the image", error)
        else:
            self.session.messages.notify("Copied the image")

    # Files

    @property
    def file_name(self) -> str:
        """The name of object A for file names."""
        return file_name(self.session.names.pair(self.session.editor.state.mix.a))

    def fit_image(self) -> None:
        """Ask for an image and fit it."""
        self.files.ask(
            FileRequest("Photo or video of one object", self.fit, (*IMAGE_SUFFIXES, *VIDEO_SUFFIXES), several=True)
        )

    def fit(self, *paths: Path) -> None:
        """Fit images of one object, show the progress, and list the images among the recent files."""
        for path in paths:
            if path.suffix.lower() in (*IMAGE_SUFFIXES, *VIDEO_SUFFIXES):
                self._remember(path)
        self.fit_unlisted(*paths)

    def fit_unlisted(self, *paths: Path) -> None:
        """Fit images of one object and show the progress."""
        self.focus = "Photo"
        self.session.fitting.start(*paths)

    def paste(self) -> None:
        """Fit the images in the clipboard."""
        jobs = self.session.jobs
        images = partial(self.clipboard.images, imgui.get_clipboard_text())
        jobs.submit(Job("paste", images, lambda paths: self.fit_unlisted(*paths), jobs.reporting("Cannot paste")))

    def open_file(self) -> None:
        """Ask for a file and open it as if it were dropped."""
        kinds = (*PROJECTS, ".json", *IMAGE_SUFFIXES, *VIDEO_SUFFIXES, *MODELS)
        title = "Photo, project or model to open"
        self.files.ask(FileRequest(title, lambda *paths: self.drop(list(map(str, paths))), kinds, several=True))

    def load(self, path: Path) -> None:
        """Open a project, a model, a scene or an image of a scene, and list the file as recent."""
        self._remember(path)
        if path.suffix.lower() in PROJECTS:
            self.session.open_project(path)
        elif path.suffix.lower() in MODELS:
            self.session.open_model(str(path))
        else:
            self.session.open_scene(path)

    def find_model(self, fingerprint: str, show: Callable[[], None]) -> None:
        """Open a missing model from its file if that is back, else ask for the file; then call ``show``."""
        path = Path(self.session.models.files.get(fingerprint, ""))

        def found(path: Path) -> None:
            self.session.open_model(str(path), fingerprint, show)

        if is_there(path):
            found(path)
        else:
            title = f"Where is {self.session.model_name(fingerprint)}?"
            self.files.ask(FileRequest(title, found, MODELS, name=path.name))

    def find_photo(self, question: Question) -> None:
        """Ask for the file of a failed fit's photo, and repeat the fit with it."""
        find = partial(self.session.answers.relocate, question)
        name = question.source.path.name
        self.files.ask(FileRequest(f"Where is {question.source.name}?", find, IMAGE_SUFFIXES, name=name))

    def save_project(self) -> None:
        """Save the project to its file; ask for a name if it has none."""
        path = self.session.project_path
        self._save_project(path) if path else self.save_project_as()

    def save_project_as(self) -> None:
        """Ask for a name and save the project."""
        name = f"{self.file_name}{SUFFIX}"
        self.files.ask(FileRequest("Save the project as", self._save_project, PROJECTS, True, name))

    def _save_project(self, path: Path) -> None:
        if self.session.save_project(path):
            self._remember(path)
        else:
            self.save_project_as()

    def share(self, kind: str = "") -> None:
        """Open the Share dialog for a kind of file (:data:`viewer.values.share_settings.KINDS`) or the last one."""
        self.share_open = True
        self.session.viewport.unfollow()  # what is shared is what is in the view, also when a fit ends
        if kind:
            self.set_preference(share=replace(self.preferences.share, kind=kind))

    def show_in_folder(self, path: Path) -> None:
        """Show a file in the system's file manager, or report why that failed."""
        try:
            self.file_manager(path)
        except ValueError as error:
            self.session.messages.report("Cannot show the folder", error)

    def drop(self, paths: list[str]) -> None:
        """Open dropped projects, models, scenes and images of scenes; fit all other files, and folders, as photos."""
        photos = []
        for path in self._files(paths):
            if path.is_dir():
                contained = image_files(path)
                photos += contained
                if not contained:
                    self.session.messages.notify(f"There is no photo in {path.name}", MessageKind.PROBLEM)
            elif path.suffix.lower() in (*PROJECTS, ".json", *MODELS) or embedded_scene(path):
                self.load(path)
            else:
                photos.append(path)
        if photos:
            self.fit(*photos)

    def _files(self, texts: list[str]) -> Iterator[Path]:
        """Yield the files that dropped texts name; report the others."""
        for text in texts:
            try:
                path = self.clipboard.file(text)
                path.exists()  # raises OSError for a name that no system allows
            except (ValueError, OSError) as error:
                self.session.messages.report("Cannot take this text", error)
            else:
                yield path

    def _remember(self, path: Path) -> None:
        if is_there(path):
            self.preferences = self.preferences.with_recent(path)


class Panel:
    """A dockable window for one subject."""

    title: str
    dock: str  # View, Left (the library) or Right (the inspector)
    folded = False  # hidden until it is chosen in the menu Panels, and can be closed
    bare = False  # has no tab, unless another panel is docked at the same place

    def draw(self, context: PanelContext) -> None:
        """Draw the panel; called once a frame, between imgui's begin and end."""
        raise NotImplementedError
