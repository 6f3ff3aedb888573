"""The shape pulled by the mouse: the direction with the largest effect under it, and how far it was moved."""

from core.rendering.grab import Pull
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.worker import Job
from viewer.values.direction import Direction

_DETAIL = 256  # px of the view's shorter side, as pulls are measured
_REACH = 3.0  # standard deviations to either side of the mean, as far as sliders go

Place = tuple[float, float]  # shares of the view's width and height


class Grabbing:
    """A pull is one step of undo."""

    def __init__(self, jobs: Jobs, editor: Editor, viewport: Viewport) -> None:
        self._jobs, self._editor, self._viewport = jobs, editor, viewport
        self.pull: Pull | None = None  # under the mouse; None until it is known, and off the object
        self._at: tuple[object, ...] = ()  # codes, camera and place of the newest search
        self._held: tuple[Direction, float] | None = None  # the direction pulled, and its strength at first

    @property
    def scale(self) -> float:
        """px of the view for one px of a pull's motion."""
        return min(self._viewport.settings.panel) / _DETAIL

    def look(self, place: Place) -> None:
        """Find the direction that a pull at a place of the view moves."""
        request = self._viewport.request
        if (at := (request.codes, request.camera, place)) == self._at:
            return
        self._at, crop, model = at, request.crop(_DETAIL), self._editor.model
        point = place[0] * crop.width + crop.left, place[1] * crop.height + crop.top
        pulls = self._jobs.backend.pulls

        def keep(found: list[Pull]) -> None:
            self.pull = found[0] if found else None

        ended, codes = self._jobs.reporting("Cannot grab the object"), request.codes
        self._jobs.submit(Job("pull", lambda: (pulls(model, codes, crop.camera, point),), keep, ended, urgent=True))

    def drag(self, drag: tuple[float, float]) -> None:
        """Move the surface by so many px of the view (right, down) from where it was grabbed."""
        if self.pull is None or (self._held is None and self._jobs.busy("pull")):
            return
        if self._held is None:
            direction = Direction.principal(self._editor.model.codes, "shape", self.pull.direction)
            self._held = direction, self._editor.strength(direction)
        direction, start = self._held
        amount = self.pull.amount((drag[0] / self.scale, drag[1] / self.scale))
        self._editor.move_along(direction, max(-_REACH, min(_REACH, start + amount)), gesture="grab")

    def release(self) -> None:
        """Let the object go: the next pull is another step of undo."""
        if self._held is not None:
            self._held = None
            self._editor.end_gesture()
