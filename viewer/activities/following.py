"""The view while a fit runs: the object on its way, from the photo's camera or from where a person turns it."""

from core.export.keyframes import View
from core.geometry.camera import Camera
from core.models.scene import Scene
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.worker import Job
from viewer.values import orbit

LIVE = RenderSettings(samples=48, divisors=(2,))
"""of a fit on its way"""


class Following:
    """The fit is followed until codes are edited or the timeline plays; turning the view is no such edit."""

    def __init__(self, jobs: Jobs, editor: Editor, viewport: Viewport) -> None:
        self._jobs, self._editor, self._viewport = jobs, editor, viewport
        self._began_from: Scene | None = None
        """what is edited, and has not been since following began; None: no fit is followed"""
        self._newest: View | None = None
        """of the fit, from the photo's camera at the model's size"""
        viewport.keep_following = self._scene_changed

    def begin(self) -> None:
        """Follow the fit from now on, from the photo's camera."""
        self._began_from = self._editor.scene
        self._editor.end_gesture()
        if self._newest:
            self._render()

    def end(self) -> None:
        """The view belongs to the scene again."""
        self._began_from = self._newest = None
        self._jobs.cancel("fit view")
        self._viewport.release("fit")

    @property
    def active(self) -> bool:
        """The view shows the fit: nobody has edited codes since that began, and the timeline rests."""
        return self._viewport.source != "timeline" and self._holds

    @property
    def turned(self) -> bool:
        """A person sees it from a camera of their own."""
        return self._began_from is not None and self._editor.scene.camera != self._began_from.camera

    @property
    def camera(self) -> Camera:
        """From where the view sees what it shows."""
        from_photo = self._newest and self.active and not self.turned
        return self._newest.camera if self._newest and from_photo else self._editor.scene.camera

    def update(self, newest: View) -> None:
        """The fit has come so far, seen from the photo's camera."""
        self._newest = newest

    def render_turned(self) -> None:
        """Show how far it has come, where a person sees it from elsewhere."""
        if self._newest and self.active and self.turned and not self._jobs.busy("fit view"):
            self._render()

    def _scene_changed(self) -> bool:
        """Whether the view stays with the fit after an edit."""
        if self._newest and self._holds:
            self._render()
        return self._holds

    @property
    def _holds(self) -> bool:
        return self._began_from is not None and self._editor.scene.codes is self._began_from.codes

    def _render(self) -> None:
        """Show the newest object at once, as the view's camera is another now."""
        assert self._newest is not None, "nothing to follow yet"
        settings = self._viewport.settings
        camera = self.camera
        crop = orbit.fit_to_panel(camera, *settings.panel, camera.height, settings.pan)
        job = RenderJob(self._newest.codes, crop.camera, LIVE)

        def rendered(frame: Frame) -> None:
            if self.active:
                self._viewport.display(frame, crop, "fit")

        frames, model = self._jobs.backend.frames, self._editor.model
        ended = self._jobs.reporting("Cannot show the search")
        self._jobs.submit(Job("fit view", lambda: frames(model, job), rendered, ended, urgent=True))
