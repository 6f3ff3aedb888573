"""The shown fit, running or finished: its steps, its selected photo and its cameras."""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
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

_MAX_KEPT = 8  # finished fits in memory


class FitView:
    """The history of the shown fit, whose steps are rendered while the view follows it, and finished fits."""

    def __init__(
        self, editor: Editor, viewport: Viewport, models: OpenModels, load: Callable[[str], Future[FitHistory]]
    ) -> None:
        """Show fits; ``load`` reads how an object was fitted, by its key."""
        self._editor = editor
        self._viewport = viewport
        self._models = models
        self._load = load
        self._loading: dict[str, Future[FitHistory]] = {}  # by key of the object
        self.history = FitHistory()
        self.key = ""  # key of the object of the last finished fit that was shown
        self.made: Mapping[str, FitHistory] = {}  # fits of this run, by key of the object, the oldest first
        self._read: dict[str, FitHistory] = {}  # fits of earlier runs, likewise; empty ones of objects without a fit
        self.preview: CutOutPreview | None = None  # cut-out of the photo that was read last
        self.read_fraction: float | None = None  # finished fraction of a video that is being read, 0..1
        self.from_runner_up = False  # the runner-up's camera is shown

    def show(self, history: FitHistory) -> None:
        """Show another fit, which is finished or about to begin."""
        self.history = history
        self.preview = None
        self.read_fraction = None
        self.from_runner_up = False

    def kept(self, key: str) -> FitHistory:
        """Return an object's fit; an empty one if that is not known, or not read yet."""
        return self.made.get(key) or self._read.get(key) or FitHistory()

    def keep(self, key: str) -> None:
        """Keep the shown fit as that of an object."""
        self.key = key
        self.take({key: self.history})

    def take(self, fits: Mapping[str, FitHistory]) -> None:
        """Keep new fits by keys of their objects; the oldest ones beyond a limit are in the store by now."""
        newest = [item for item in self.made.items() if item[0] not in fits][-_MAX_KEPT:]
        self.made = {**dict(newest), **fits}
        self._read = {key: fit for key, fit in self._read.items() if key not in fits}

    def show_kept(self, key: str) -> None:
        """Show the fit of an object, once it is read, unless it is shown; nothing if it is not known."""
        if key == self.key or not key:
            return
        if key not in self.made and key not in self._read:
            if key not in self._loading:
                self._loading[key] = self._load(key)
            if not (loading := self._loading[key]).done():
                return
            del self._loading[key]
            self._read[key] = loading.result()
            while len(self._read) > _MAX_KEPT:
                del self._read[next(iter(self._read))]
        if (fit := self.kept(key).converted(self._models.adopt)).sources:
            self.key = key
            self.show(fit)

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
