"""The shown fit, running or finished: its steps, its selected photo and its cameras."""

from dataclasses import replace

from core.export.films import View
from core.fitting.fit import FitStep, RunnerUp
from core.geometry.camera import Camera
from core.models.model import Model
from core.models.open_models import OpenModels
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.values.cut_out_preview import CutOutPreview
from viewer.values.fit_history import FitHistory

_MAX_KEPT = 8  # finished fits whose histories are kept


class FitView:
    """The history of the shown fit, whose steps are rendered while the view follows it, and finished fits."""

    def __init__(self, editor: Editor, viewport: Viewport, models: OpenModels) -> None:
        self._editor = editor
        self._viewport = viewport
        self._models = models
        self.history = FitHistory()
        self.name = ""  # name of the object of the last finished fit that was shown
        self._finished: dict[str, FitHistory] = {}  # by name of the object, the oldest first
        self.preview: CutOutPreview | None = None  # cut-out of the photo that was read last
        self.read_fraction: float | None = None  # finished fraction of a video that is being read, 0..1
        self.from_runner_up = False  # the runner-up's camera is shown

    def show(self, history: FitHistory) -> None:
        """Show another fit, which is finished or about to begin."""
        self.history = history
        self.preview = None
        self.read_fraction = None
        self.from_runner_up = False

    def kept(self, name: str) -> FitHistory:
        """Return an object's fit; an empty one if it was not made in this run."""
        return self._finished.get(name, FitHistory())

    def keep(self, name: str) -> None:
        """Keep the shown fit as that of an object."""
        self.name = name
        self._finished[name] = self.history
        while len(self._finished) > _MAX_KEPT:
            del self._finished[next(iter(self._finished))]

    def show_kept(self, name: str) -> None:
        """Show the fit of an object, unless it is shown or was not made in this run."""
        if name != self.name and name in self._finished:
            self.name = name
            self.show(self._finished[name])

    def rename(self, name: str, to: str) -> None:
        """Follow the renaming of an object."""
        self._finished = {to if key == name else key: history for key, history in self._finished.items()}
        self.name = to if self.name == name else self.name

    @property
    def model(self) -> Model:
        """The model of the fit. Raises ``ValueError`` until it is known."""
        return self._models[self.history.model]

    @property
    def camera(self) -> Camera:
        """The selected photo's camera: the newest step's or, if shown, the runner-up's.

        It has the size of the model's images. There must be a step.
        """
        step = self.history.last
        assert step is not None, "nothing found yet"
        return self.camera_of(step.runner_up if self.from_runner_up and step.runner_up else step)

    def show_viewpoint(self, runner_up: bool) -> None:
        """Turn the view to the runner-up's camera, mostly opposite, or back to the fitted one."""
        if self.history.last:
            self.from_runner_up = runner_up
            self._editor.set_camera(self.camera)

    def camera_of(self, result: FitStep | RunnerUp) -> Camera:
        """Return the selected photo's camera in a step or runner-up, at the size of the model's images."""
        size = self.model.image_size
        return result.cameras[self.history.photo_index].resized(size, size)

    def show_photo(self, index: int) -> None:
        """Select another photo."""
        if 0 <= index < len(self.history.photos):
            self.history = replace(self.history, photo_index=index)

    def add_step(self, step: FitStep) -> None:
        """Add a step of the running fit, which a view that follows it shows."""
        self.history = self.history.with_step(step)
        self._viewport.show_live(View(step.instance, self.camera_of(step)))
