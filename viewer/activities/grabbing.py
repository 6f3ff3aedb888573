"""Pulls of the shape by the mouse, along the principal direction of the drag's axis, or the largest there."""

import math
from collections.abc import Sequence

from core.directions.grab import Pull, dragged_pull
from core.geometry.camera import Camera
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.worker import Job
from viewer.values.direction import Direction

_DETAIL = 256  # px of the view's shorter side when measuring pulls
_BEGUN = 4.0  # px of the view after which a drag's direction is known

Place = tuple[float, float]  # fractions of the view's width and height


class Grabbing:
    """Finds and applies pulls; a pull is one step of undo."""

    def __init__(self, jobs: Jobs, editor: Editor, viewport: Viewport) -> None:
        self._jobs, self._editor, self._viewport = jobs, editor, viewport
        self.pull: Pull | None = None  # pull under the mouse; None until it is known, and off the object
        self._found: tuple[list[Pull], Camera, tuple[float, float]] | None = None  # pulls, and the px of their search
        self._at: tuple[object, ...] = ()  # object, camera and place of the newest search
        self._held: tuple[Direction, float] | None = None  # pulled direction, and its strength when the pull began

    @property
    def scale(self) -> float:
        """The px of the view per px of a pull's motion."""
        return min(self._viewport.settings.panel) / _DETAIL

    def look(self, place: Place) -> None:
        """Begin to find the pull at a place of the view."""
        request = self._viewport.request
        if (at := (request.instance, request.camera, place)) == self._at:
            return
        self._at, crop = at, request.crop(_DETAIL)
        point = place[0] * crop.width + crop.left, place[1] * crop.height + crop.top
        pulls = self._jobs.backend.pulls

        def keep(found: list[Pull]) -> None:
            self.pull = found[0] if found else None
            self._found = (found, crop.camera, point) if found else None

        ended, instance = self._jobs.reporting("Cannot grab the object"), request.instance
        self._jobs.submit(Job("pull", lambda: (pulls(instance, crop.camera, point),), keep, ended, urgent=True))

    def drag(self, drag: tuple[float, float], words: Sequence[str] = ()) -> None:
        """Move the surface by ``drag`` px of the view (right, down) from where the pull began.

        Args:
            words: of the shape directions.
        """
        if self.pull is None or self._found is None:
            return
        if self._held is None:
            if self._jobs.busy("pull") or math.hypot(*drag) < _BEGUN:
                return
            pulls, camera, point = self._found
            self.pull = dragged_pull(pulls, words, camera, point, drag)
            direction = Direction.principal(self._editor.model.codes, "shape", self.pull.direction)
            self._held = direction, self._editor.strength(direction)
        direction, start = self._held
        amount = self.pull.amount((drag[0] / self.scale, drag[1] / self.scale))
        self._editor.move_along(direction, start + amount, gesture="grab")

    def release(self) -> None:
        """End the pull; the next one is another step of undo."""
        if self._held is not None:
            self._held = None
            self._editor.end_gesture()
