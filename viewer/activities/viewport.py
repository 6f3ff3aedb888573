"""The view: how its image is rendered, how large and how fine, and what is on screen."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

from core.models.codes import Codes
from core.rendering.baked_field import BakedField
from core.rendering.frame_budget import FrameBudget
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.worker import Job
from viewer.values import orbit
from viewer.values.quality import DEFAULT_QUALITY, QUALITIES, Quality

Source = Literal["scene", "timeline", "fit"]
_SUPERSAMPLING = 2
"""Pixels rendered across each pixel of the finished image."""
_REST = 0.4
"""s without a change after which the image is rendered at the view's own resolution"""
_STILL = 0.15
"""s without a change after which the exact picture is rendered that replaces one drawn by OpenGL"""
_BAKE_SHARE = 0.5
"""of the worker's time"""
_REST_SHARE = 0.5
"""of the worker's time, for that"""


@dataclass(eq=False)
class ViewSettings:
    """How the object is seen, whichever model is open."""

    panel: tuple[int, int] = (512, 512)
    """px, the size of the view"""
    pan: tuple[float, float] = (0.0, 0.0)
    """how far the object is moved right and down in the view, in shares of its shorter side"""
    quality: Quality = QUALITIES[DEFAULT_QUALITY]
    budget: FrameBudget = field(default_factory=FrameBudget)
    baking: bool = False
    """objects are baked, and drawn by OpenGL while they are turned"""


class Viewport:
    """Renders the edited scene, coarse to fine, unless the timeline or a fit displays its own. Nothing is an edit."""

    def __init__(self, jobs: Jobs, editor: Editor, settings: ViewSettings) -> None:
        self._jobs, self._editor, self.settings = jobs, editor, settings
        self.source: Source = "scene"
        """what displays its frames here"""
        self.frame: Frame | None = None
        """the newest frame, as the panel shows it"""
        self.full_frame: tuple[Frame, orbit.PanelCrop] | None = None
        """the whole frame, and what of it is shown"""
        self.times: tuple[tuple[tuple[int, int], float], ...] = ()
        """of the frame on screen: size (px) of each stage so far, and s from the start of its job"""
        self.sharp = False
        """the frame on screen is finished, of the scene as it is now, and has every pixel of the view"""
        self.baked: BakedField | None = None
        """the object, of which what is drawn by OpenGL"""
        self.turning: orbit.PanelCrop | None = None
        """what is to be seen of :attr:`baked` now; None: the frame is shown"""
        self._turned = 0.0
        """s on the monotonic clock, when it was turned last"""
        self._baked_of: Codes | None = None
        """what is baked, or being baked"""
        self._rested: float | None = None
        """s on the monotonic clock, when the image was finished that has fewer pixels than the view"""
        self.keep_following: Callable[[], bool] = lambda: False
        """called after an edit while a fit is shown: whether it still is"""
        editor.scene_changed = self._scene_changed

    def close(self) -> None:
        """Render no more."""
        self._jobs.cancel("view", "bake")

    def resize(self, width: int, height: int) -> None:
        """The view has another size."""
        if (width, height) != self.settings.panel and min(width, height) > 0:
            self.settings.panel = width, height
            self.render()

    def pan_by(self, across: float, down: float) -> None:
        """Move the object in the view."""
        self.settings.pan = orbit.panned(self.settings.pan, across, down)
        self.render()

    def reset_view(self) -> None:
        """Back to where a model is first seen from."""
        if self.settings.pan != (0.0, 0.0):
            self.settings.pan = 0.0, 0.0
            self.render()
        self._editor.set_camera(orbit.home(self._editor.model))

    def set_quality(self, quality: Quality) -> None:
        """Render coarser or finer."""
        self.settings.quality = quality
        self.render()

    def render(self) -> None:
        """Render the scene, in place of a render under way; not while the timeline plays or a fit is followed."""
        if self.source != "scene":
            return
        self._rested, self.sharp = None, False
        if self.is_baked(self._editor.scene.codes):
            self._jobs.cancel("view")
            self._turn()
            return
        self.turning = None
        if self._baked_of not in (None, self._editor.scene.codes):
            self._jobs.cancel("bake")
            self.baked = self._baked_of = None
        budget, detail = self.settings.budget, min(self.settings.quality.detail, self._sides)
        stages = budget.divisors(detail)

        def rendered(frame: Frame, crop: orbit.PanelCrop) -> None:
            earlier = self.times if self.full_frame and self.full_frame[1] is crop else ()
            self.times = (*earlier, (frame.resolution, frame.seconds))
            self._show(frame, crop)
            self.sharp = frame.final and detail == self._sides
            if frame.stage == 0:
                budget.observe(stages[0], frame.seconds)
            if frame.final and not self.sharp:
                self._rested = time.monotonic()

        self._submit(detail, stages, rendered, urgent=True)

    def tick(self) -> None:
        """Once a frame: give the image all pixels of the view, once the hand rests and no fit needs the time; bake."""
        if self.source == "scene" and not self._jobs.busy("view"):
            if self.settings.baking:
                self._bake(self._editor.scene.codes)
            if self.turning:
                self._replace_turning()
        if self._rested is None or time.monotonic() - self._rested < _REST or self._jobs.busy("fit"):
            return
        self._rested = None

        def rendered(frame: Frame, crop: orbit.PanelCrop) -> None:
            self.times = (*self.times, (frame.resolution, self.times[-1][1] + frame.seconds))
            self._show(frame, crop)
            self.sharp = frame.final

        self._submit(self._sides, (1,), rendered, share=_REST_SHARE)

    def set_baking(self, baking: bool) -> None:
        """Whether OpenGL may draw the object while it is turned."""
        if baking != self.settings.baking:
            self.settings.baking = baking
            if self.turning:
                self.render()

    def is_baked(self, codes: Codes) -> bool:
        """OpenGL can draw this object now."""
        return self.settings.baking and self.baked is not None and codes == self._baked_of

    def turn(self, source: Source) -> None:
        """Let OpenGL draw the scene's object in the place of this source's frames; it :meth:`is_baked`."""
        self.hold(source)
        self._turn()

    def _turn(self) -> None:
        self.turning = orbit.fit_to_panel(
            self._editor.scene.camera, *self.settings.panel, self._sides, self.settings.pan
        )
        self._turned, self.sharp = time.monotonic(), False

    def _replace_turning(self) -> None:
        """Render the exact picture once the hand rests, as large as the one that OpenGL draws until it is there."""
        if time.monotonic() - self._turned < _STILL:
            return
        detail = min(self.settings.quality.detail, self._sides) if self._jobs.busy("fit") else self._sides

        def rendered(frame: Frame, crop: orbit.PanelCrop) -> None:
            earlier = self.times if self.full_frame and self.full_frame[1] is crop else ()
            self.times = (*earlier, (frame.resolution, frame.seconds))
            self._show(frame, crop)
            self.sharp = frame.final and detail == self._sides

        self._submit(detail, (1,), rendered)

    def _bake(self, codes: Codes) -> None:
        """Bake an object, unless it is the one that is baked already."""
        if codes == self._baked_of:
            return
        self._baked_of = codes

        def baked(found: BakedField) -> None:
            self.baked = found

        bake, model = self._jobs.backend.bake, self._editor.model
        ended = self._jobs.reporting("Cannot bake the object")
        self._jobs.submit(Job("bake", lambda: bake(model, codes), baked, ended, share=_BAKE_SHARE))

    @property
    def _sides(self) -> int:
        """px of the view's shorter side."""
        return min(self.settings.panel)

    def _submit(
        self,
        detail: int,
        stages: tuple[int, ...],
        rendered: Callable[[Frame, orbit.PanelCrop], None],
        urgent: bool = False,
        share: float = 1.0,
    ) -> None:
        """Render the scene, so many px along the view's shorter side."""
        scene, frames, model = self._editor.scene, self._jobs.backend.frames, self._editor.model
        crop = orbit.fit_to_panel(scene.camera, *self.settings.panel, detail, self.settings.pan)
        settings = RenderSettings(self.settings.quality.samples, stages, supersampling=_SUPERSAMPLING)
        job = RenderJob(scene.codes, crop.camera, settings)
        ended = self._jobs.reporting("Cannot render the object")
        self._jobs.submit(
            Job("view", lambda: frames(model, job), lambda frame: rendered(frame, crop), ended, urgent, share)
        )

    def hold(self, source: Source) -> None:
        """Render no scene until :meth:`release`: this source will display frames of its own."""
        self.source, self._rested, self.turning = source, None, None
        self._jobs.cancel("view")

    def display(self, frame: Frame, crop: orbit.PanelCrop, source: Source) -> None:
        """Show a frame of the timeline or of a fit, until the scene is edited or :meth:`release` is called."""
        self.hold(source)
        self._show(frame, crop)

    def release(self, source: Source) -> None:
        """Go back to the scene, if the view shows this source."""
        if self.source == source:
            self.source = "scene"
            self.render()

    def _scene_changed(self) -> None:
        """The timeline edits the scene while it plays; an edit of codes ends following a fit."""
        if self.source == "fit" and not self.keep_following():
            self.source = "scene"
        self.render()

    def _show(self, frame: Frame, crop: orbit.PanelCrop) -> None:
        self.full_frame, self.frame, self.sharp = (frame, crop), crop.cropped(frame), False
        self.turning = None
