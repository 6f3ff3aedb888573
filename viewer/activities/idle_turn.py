"""A slow turn of a fitted object until something is touched."""

import math
import time
from collections.abc import Callable
from dataclasses import replace

from core.geometry.camera import Camera
from core.models.scene import Scene
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.values import orbit

_REST = 2.0  # s that the finished image is shown before the turn
_SPEED = 2 * math.pi / 40  # rad/s


class IdleTurn:
    """Turns the view of a new result, if OpenGL draws the baked object.

    The turn begins at the scene's camera and is no edit; :meth:`stop` keeps its last camera.
    """

    def __init__(
        self, jobs: Jobs, editor: Editor, viewport: Viewport, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._jobs, self._editor, self._viewport, self._clock = jobs, editor, viewport, clock
        self._of: Scene | None = None  # scene to turn; another scene ends the turn
        self._began: float | None = None  # s on the clock when the turn begins; None until that is known
        self._shown: Camera | None = None  # camera of the turned view
        viewport.result_shown.connect(self._prepare)

    @property
    def due(self) -> bool:
        """True while the view turns, or will turn once the finished image is shown."""
        return self._of is not None

    @property
    def turning(self) -> bool:
        """True while the view turns."""
        return self._began is not None and self._clock() >= self._began

    @property
    def _edited(self) -> bool:
        """True if the scene differs from the one to turn."""
        scene, of = self._editor.scene, self._of
        return of is None or scene.instance is not of.instance or not orbit.same_direction(scene.camera, of.camera)

    def _prepare(self) -> None:
        self._of, self._began, self._shown = self._editor.scene, None, None

    def tick(self) -> None:
        """Turn a little; call once a frame while nothing is touched."""
        viewport, scene = self._viewport, self._editor.scene
        if not self.due or viewport.source != "scene" or self._jobs.busy("fit", "framing"):
            self._began = self._shown = None
        elif self._edited:
            self._of = self._began = self._shown = None
        elif self._began is None:
            ready = viewport.sharp and viewport.is_baked(scene.instance)
            self._began = self._clock() + _REST if ready else None
        elif self.turning:
            azimuth = _SPEED * (self._clock() - self._began)
            self._shown = orbit.turned(scene.camera, azimuth, 0.0)
            viewport.show_turned(self._shown)
            self._jobs.worker.wake()

    def stop(self) -> None:
        """Stop; the scene's camera becomes that of the turned view, as part of the last edit."""
        turns = self.turning and not self._edited and self._viewport.source == "scene"
        scene, shown = self._editor.scene, self._shown if turns else None
        self._of = self._began = self._shown = None
        if shown:
            self._editor.join(replace(scene, camera=replace(scene.camera, azimuth=shown.azimuth)))
