"""How the fit under way, or the last one, is shown: its steps and photos, and renders from their cameras."""

import math
import time
from dataclasses import replace

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from core.export.keyframes import View
from core.fitting.fit import FitStep, RunnerUp
from core.geometry.camera import Camera
from core.models.model import Model
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from viewer.activities.viewport import LIVE, Viewport
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.worker import Job
from viewer.values import orbit
from viewer.values.fit_history import FitHistory

_RENDER_EVERY = 0.3  # s between two renders of the fit, which take their time from it
_RENDER_STEPS = 4  # steps between two renders at the least, for machines on which they are slow
_FINISHED = RenderSettings(divisors=(1,))


class FitView:
    """Renders for the comparison with the photo; where the view follows the fit, also for that."""

    def __init__(self, jobs: Jobs, editor: Editor, viewport: Viewport) -> None:
        self._jobs, self._editor, self._viewport = jobs, editor, viewport
        self.history = FitHistory()
        self.from_runner_up = False  # shown from the runner-up's camera
        self._rendered_at, self._steps_since = 0.0, 0  # time (s) of the last render, and steps since

    def show(self, history: FitHistory) -> None:
        """Show another fit, which has not begun or is over."""
        self.history, self.from_runner_up = history, False
        self._rendered_at, self._steps_since = 0.0, 0

    def close(self) -> None:
        """Render no more of it; the view belongs to the scene again."""
        self._jobs.cancel("fit frame")
        self._viewport.unfollow()

    @property
    def model(self) -> Model:
        """The model that is fitted. Only once that is known."""
        return self._jobs.models[self.history.model]

    @property
    def camera(self) -> Camera:
        """The photo's camera in the step and viewpoint shown, at the size of the model's images. Only once there are
        steps.
        """
        step = self.history.step
        assert step is not None, "nothing found yet"
        return self.camera_of(self._seen(step))

    def _seen(self, step: FitStep) -> FitStep | RunnerUp:
        """The cameras of the viewpoint that is shown."""
        return step.runner_up if self.from_runner_up and step.runner_up else step

    def show_viewpoint(self, runner_up: bool) -> None:
        """See the object, and its render, from where the photo was found to be taken, or from the runner-up's camera,
        mostly on the object's other side.
        """
        if step := self.history.step:
            self.from_runner_up = runner_up
            self._editor.set_camera(self.camera)
            self._render(step, _FINISHED)

    def camera_of(self, found: FitStep | RunnerUp) -> Camera:
        """The camera of the photo that is shown, at the size of the model's images."""
        size = self.model.image_size
        return found.cameras[self.history.photo_index].resized(size, size)

    def _moved(self, step: FitStep) -> tuple[int, int, float]:
        """How many px right and below the photo shows what its camera sees in its middle, and how far it is turned
        around that (rad, clockwise).
        """
        model, index, cameras = self.model, self.history.photo_index, self._seen(step).cameras
        for one in step.hypotheses:
            if one.cameras == cameras:
                size = model.focal * cameras[index].height / model.image_size
                _, roll, *shift = one.crop_transform[index].tolist()
                return round(size * shift[0]), round(size * shift[1]), roll
        return 0, 0, 0.0

    def scrub(self, index: int | None, gesture: str = "") -> None:
        """Show a step: its codes, seen from its camera, are an edit of the scene. None is the newest step."""
        if not self.history.steps:
            return
        last = len(self.history.steps) - 1
        self.history = replace(self.history, selected=None if index is None else max(0, min(index, last)))
        if step := self.history.step:
            self._editor.show(step.codes, self.camera, gesture)
            self._render(step, LIVE)

    def show_photo(self, index: int) -> None:
        """Show another photo."""
        if 0 <= index < len(self.history.photos):
            self.history = replace(self.history, photo_index=index, frame=None, difference=None)
            if self.history.step:
                self._render(self.history.step, LIVE)

    def add_step(self, step: FitStep) -> None:
        """Show a step more of the fit under way, rendered where the last render is long enough ago."""
        self.history = self.history.with_step(step)
        self._viewport.update_live(View(step.codes, self.camera_of(step)))
        self._steps_since += 1
        due = self._steps_since >= _RENDER_STEPS and time.monotonic() - self._rendered_at > _RENDER_EVERY
        if due and self.history.selected is None and not self._jobs.busy("fit frame"):
            self._render(step, LIVE)
            self._viewport.render_turned()

    def finish(self) -> None:
        """Show the newest step, finished."""
        self.history, self.from_runner_up = replace(self.history, selected=None), False
        if self.history.last:
            self._render(self.history.last, _FINISHED)

    @property
    def _fills_view(self) -> bool:
        """The view shows the fit from the photo's camera."""
        return self._viewport.following and not self._viewport.turned

    def _render(self, step: FitStep, settings: RenderSettings) -> None:
        """A step from the photo's camera; as wide as the view while that follows the fit from there."""
        self._rendered_at, self._steps_since = time.monotonic(), 0
        index, view, fills = self.history.photo_index, self._viewport.settings, self._fills_view
        camera = self._seen(step).cameras[index]
        layout = (*view.panel, camera.height, view.offset) if fills else (camera.width, camera.height, camera.height)
        right, below, roll = self._moved(step)
        crop = orbit.fit_to_panel(camera, *layout).widened(abs(right), abs(below))
        job = RenderJob(step.codes, crop.camera, settings, shadow=True)

        def rendered(frame: Frame) -> None:
            if fills and self._fills_view:
                self._viewport.display(frame, crop, "fit")
            if index == self.history.photo_index and (fitted := self.history.photo):
                middle = crop.middle(camera, right, below).cropped(frame)
                shift = right / camera.width, below / camera.height
                middle = replace(middle, image=_turned(middle.image, roll, shift))
                difference = fitted.doubled_difference(middle.image)
                self.history = replace(self.history, frame=middle, difference=difference)

        ended = self._jobs.reporting("Cannot show the search")
        # While a person scrubs, each frame is shown before the next replaces it.
        urgent = self.history.selected is not None
        self._jobs.submit(Job("fit frame", lambda: self._jobs.frames(job), rendered, ended, urgent))


def _turned(
    image: UInt8[np.ndarray, "height width 3"], roll: float, shift: tuple[float, float]
) -> UInt8[np.ndarray, "height width 3"]:
    """Turned clockwise (rad) around a place right of and below its middle, in shares of its size; white beyond it."""
    if not roll:
        return image
    height, width = image.shape[:2]
    about = width * (0.5 + shift[0]), height * (0.5 + shift[1])
    turned = Image.fromarray(image).rotate(
        -math.degrees(roll), Image.Resampling.BICUBIC, center=about, fillcolor="white"
    )
    return np.asarray(turned)
