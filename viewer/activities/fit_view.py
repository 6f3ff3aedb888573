"""The fit under way, or the last one, as the window shows it: its steps, photos and cameras."""

import time
from dataclasses import replace

from core.export.keyframes import View
from core.fitting.fit import FitStep, RunnerUp
from core.geometry.camera import Camera
from core.models.model import Model
from core.models.open_models import OpenModels
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.values.fit_history import FitHistory
from viewer.values.seen_cut_out import SeenCutOut

_RENDER_EVERY = 0.3  # s between two renders of the fit, which take their time from it
_RENDER_STEPS = 4  # steps between two renders at the least, for machines on which they are slow


class FitView:
    """Shows the steps of a fit in the view where that follows the fit."""

    def __init__(self, editor: Editor, viewport: Viewport, models: OpenModels) -> None:
        self._editor, self._viewport, self._models = editor, viewport, models
        self.history = FitHistory()
        self.seen: SeenCutOut | None = None  # the cut-out of the photo read last
        self.from_runner_up = False  # seen from the runner-up's camera
        self._rendered_at, self._steps_since = 0.0, 0  # time (s) of the last render, and steps since

    def show(self, history: FitHistory) -> None:
        """Show another fit, which has not begun or is over."""
        self.history, self.seen, self.from_runner_up = history, None, False
        self._rendered_at, self._steps_since = 0.0, 0

    def close(self) -> None:
        """Give the view back to the scene."""
        self._viewport.unfollow()

    @property
    def model(self) -> Model:
        """The model that is fitted. Only once that is known."""
        return self._models[self.history.model]

    @property
    def camera(self) -> Camera:
        """The photo's camera in the newest step and the viewpoint shown, at the size of the model's images. Only once
        there are steps.
        """
        step = self.history.last
        assert step is not None, "nothing found yet"
        return self.camera_of(step.runner_up if self.from_runner_up and step.runner_up else step)

    def show_viewpoint(self, runner_up: bool) -> None:
        """Turn the view to the camera that was found, or to the runner-up's, mostly on the object's other side."""
        if self.history.last:
            self.from_runner_up = runner_up
            self._editor.set_camera(self.camera)

    def camera_of(self, found: FitStep | RunnerUp) -> Camera:
        """The camera of the photo that is shown, at the size of the model's images."""
        size = self.model.image_size
        return found.cameras[self.history.photo_index].resized(size, size)

    def show_photo(self, index: int) -> None:
        """Show another photo."""
        if 0 <= index < len(self.history.photos):
            self.history = replace(self.history, photo_index=index)

    def add_step(self, step: FitStep) -> None:
        """Show a step more of the fit under way, rendered where the last render is long enough ago."""
        self.history = self.history.with_step(step)
        self._viewport.update_live(View(step.codes, self.camera_of(step)))
        self._steps_since += 1
        due = self._steps_since >= _RENDER_STEPS and time.monotonic() - self._rendered_at > _RENDER_EVERY
        if due:
            self._rendered_at, self._steps_since = time.monotonic(), 0
            self._viewport.render_live()
