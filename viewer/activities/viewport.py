"""The view: what it shows and from where, how its image is rendered, and what is on screen."""

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

from core.export.keyframes import View
from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.scene import Scene
from core.rendering.baked_field import BakedField
from core.rendering.frame_budget import FrameBudget
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from viewer.activities.framing import Framing
from viewer.activities.thumbnails import digest, frame_of, pixels_of
from viewer.editor import Editor
from viewer.services.jobs import SHARPENING_SHARE, TILES_SHARE, Jobs
from viewer.services.kept_thumbnails import Pixels
from viewer.services.signal import Signal
from viewer.services.worker import Job
from viewer.values import orbit
from viewer.values.view_request import ViewRequest, ViewSettings

Source = Literal["none", "scene", "timeline", "fit"]
LIVE = RenderSettings(samples=48, divisors=(2,))  # of a fit on its way
_FULL_RESOLUTION_DELAY = 0.4  # s without a change after which the image is rendered at the view's own resolution
_EXACT_DELAY = 0.15  # s without a change after which the exact image is rendered that replaces one drawn by OpenGL


class Viewport:
    """Shows the edited scene; while one of them displays frames, the timeline or the fit. Nothing here is an edit.

    A fit is followed until codes are edited or the timeline plays; turning the view is no such edit.
    """

    def __init__(self, jobs: Jobs, editor: Editor, settings: ViewSettings) -> None:
        self._jobs, self._editor, self.settings = jobs, editor, settings
        self.source: Source = "none"  # what displays its frames here; none until :meth:`begin`
        self.frame: Frame | None = None  # the newest frame, as the panel shows it
        self.full_frame: tuple[Frame, orbit.PanelCrop] | None = None  # the whole frame, and what of it is shown
        self.times: tuple[tuple[tuple[int, int], float], ...] = ()  # of each stage: px, s from the start
        self.sharp = False  # the frame on screen is finished and has every pixel of the view
        self.budget = FrameBudget()
        self.baked: BakedField | None = None  # the object, of which what is drawn by OpenGL
        self.baked_frame: orbit.PanelCrop | None = None  # the view of :attr:`baked`; None: the frame is shown
        self._baked_of: Codes | None = None  # what is baked, or being baked
        self._last_orbit = 0.0  # s on the monotonic clock, when the baked object was turned last
        self._last_render: float | None = None  # time (s) when the coarse image was finished
        self._sharpens: tuple[float, float] = 0.0, 0.0  # begin (s) of the sharp image, its likely s
        self._live: View | None = None  # the newest object of the fit, from the photo's camera at the model's size
        self._followed_since: Scene | None = None  # scene when following began; None: nothing is followed
        editor.scene_changed.connect(self._refresh)
        self.framing = Framing(jobs, editor)
        self.result_shown = Signal[[]]()  # emitted when what a fit has found is in the view
        editor.object_chosen.connect(self._show_chosen)

    def begin(self, pictures: Mapping[str, Pixels] | None = None) -> None:
        """Render the scene from now on; until that is there, show its picture among kept ones, if it is one of them."""
        request = self.request
        if (found := (pictures or {}).get(_picture(request))) is not None:
            height, width = found.shape[:2]
            self._show(frame_of(found, stages=2), orbit.fit_to_panel(request.camera, width, height, min(width, height)))
        if self.source == "none":
            self.source = "scene"
        self.render()

    @property
    def picture(self) -> dict[str, Pixels]:
        """What is in the view, to be kept, by its name; nothing unless it is finished and of the scene."""
        finished = self.frame and self.frame.final and not (self.baked_frame or self._jobs.busy("view"))
        if not (finished and self.source == "scene" and self.settings.mode == "colour"):
            return {}
        assert self.frame is not None
        return {_picture(self.request): pixels_of(self.frame)}

    def close(self) -> None:
        """Render no more."""
        self._jobs.cancel("view", "bake", "fit view", "framing")

    @property
    def camera(self) -> Camera:
        """From where the view sees what it shows: where orbit and zoom begin."""
        return self.request.camera

    @property
    def request(self) -> ViewRequest:
        """All that the image depends on that the view is to show now."""
        scene, live = self._editor.scene, self._live if self.source == "fit" else None
        return self._request_live(live) if live else ViewRequest(scene.codes, scene.camera, self.settings)

    def _request_live(self, live: View) -> ViewRequest:
        """The fit, from the photo's camera until a person turns it."""
        camera = self._editor.scene.camera if self.turned else live.camera
        return ViewRequest(live.codes, camera, self.settings)

    def change(self, **settings: Any) -> None:
        """Change :class:`~viewer.values.view_request.ViewSettings` by their names; rendered again where it matters."""
        before, self.settings = self.settings, replace(self.settings, **settings)
        as_before = replace(self.settings, mode=before.mode, opengl=before.opengl) == before
        if not as_before or (self.baked_frame and not self.settings.baked):
            self._refresh()
        if self.settings.panel != before.panel and not self._editor.history.past:
            self.framing.keep_size(self.settings.panel)

    def pan_by(self, across: float, down: float) -> None:
        """Move the object in the view."""
        self.change(pan=orbit.panned(self.settings.pan, across, down))

    def reset_view(self) -> None:
        """Back to where a model is first seen from."""
        self.change(pan=(0.0, 0.0))
        self._editor.set_camera(orbit.home(self._editor.model))
        self.framing.frame(self.settings.panel)

    def frame_result(self) -> None:
        """Show all of the object that a fit has found, in the middle."""
        self.change(pan=(0.0, 0.0))
        self.framing.frame(self.settings.panel)
        self.result_shown.emit()

    @property
    def sharpened(self) -> float | None:
        """How far the image of all pixels is (0..1), by the time of a smaller one; None unless it is under way."""
        begun, seconds = self._sharpens
        if not begun or self.sharp or not self._jobs.busy("view"):
            return None
        return min(0.95, (time.monotonic() - begun) / max(0.1, seconds))

    def render(self) -> None:
        """Render the scene, in place of a render under way; not while the timeline plays or a fit is followed."""
        if self.source != "scene":
            return
        self._last_render, self.sharp, self._sharpens = None, False, (0.0, 0.0)
        request = self.request
        if self.is_baked(request.codes):
            self._jobs.cancel("view")
            self._show_baked(request)
            return
        self.baked_frame = None
        if self._baked_of not in (None, request.codes):
            self._jobs.cancel("bake")
            self.baked = self._baked_of = None
        self._submit(request, request.preview, self.budget.divisors(request.preview), urgent=True)

    def tick(self) -> None:
        """Once a frame: give the image all pixels of the view, once the hand rests and no fit needs the time; bake."""
        now, request = time.monotonic(), self.request
        if self.source == "scene" and not self._jobs.busy("view"):
            if self.settings.baked:
                self._bake(request.codes)
            if self.baked_frame and now - self._last_orbit >= _EXACT_DELAY:
                # As large as the one that OpenGL draws until it is there.
                self._submit(request, request.preview if self._jobs.busy("fit") else request.full)
        rests = self._last_render is not None and now - self._last_render >= _FULL_RESOLUTION_DELAY
        if rests and not self._jobs.busy("fit"):
            self._last_render = None
            pixels = (request.full / request.preview) ** 2
            self._sharpens = now, pixels * (self.times[-1][1] if self.times else 0.0)
            self._submit(request, request.full, continues=True)

    # Baked by core, drawn by OpenGL

    def is_baked(self, codes: Codes) -> bool:
        """OpenGL can draw this object now."""
        return self.settings.baked and self.baked is not None and codes == self._baked_of

    def baked_copy(self, codes: Codes) -> BakedField | None:
        """Of this object, if there is one."""
        return self.baked if codes == self._baked_of else None

    def show_baked(self, source: Source) -> None:
        """Let OpenGL draw the scene's object in the place of this source's frames; it :meth:`is_baked`."""
        self.hold(source)
        self._show_baked(self.request)

    def show_turned(self, camera: Camera) -> None:
        """Let OpenGL draw the scene's object from another camera; it :meth:`is_baked`."""
        self._show_baked(replace(self.request, camera=camera))

    def _show_baked(self, request: ViewRequest) -> None:
        self.baked_frame, self.sharp = request.crop(request.full), False
        self._last_orbit = time.monotonic()

    def _bake(self, codes: Codes) -> None:
        """Bake an object, unless it is the one that is baked already."""
        if codes == self._baked_of:
            return
        self._baked_of = codes

        def baked(found: BakedField) -> None:
            self.baked = found

        bake, model = self._jobs.backend.bake, self._jobs.models.of(codes)
        ended = self._jobs.reporting("Cannot bake the object")
        self._jobs.submit(Job("bake", lambda: bake(model, codes), baked, ended, share=TILES_SHARE))

    # Frames of the timeline, and of a fit

    def hold(self, source: Source) -> None:
        """Render no scene until :meth:`release`: this source will display frames of its own."""
        self.source, self._last_render, self.baked_frame = source, None, None
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

    @property
    def following(self) -> bool:
        """The view shows the fit: nobody has edited codes since that began, and the timeline rests."""
        since = self._followed_since
        return self.source != "timeline" and since is not None and self._editor.scene.codes is since.codes

    @property
    def turned(self) -> bool:
        """A person sees the fit from a camera of their own."""
        since = self._followed_since
        return since is not None and self._editor.scene.camera != since.camera

    def follow(self) -> None:
        """Show the fit from now on, from the photo's camera."""
        self._jobs.cancel("framing")
        self._followed_since = self._editor.scene
        self._editor.end_gesture()
        self._render_live()

    def unfollow(self) -> None:
        """Show the scene again; the fit is over."""
        self._followed_since = self._live = None
        self._jobs.cancel("fit view")
        self.release("fit")

    def update_live(self, newest: View) -> None:
        """Keep how far the fit has come, seen from the photo's camera at the model's size."""
        self._live = newest

    def render_live(self) -> None:
        """Show how far the fit has come, unless that is under way."""
        if not self._jobs.busy("fit view"):
            self._render_live()

    def _render_live(self) -> None:
        """Show the newest object of the fit at once, if there is one."""
        if not (self._live and self.following):
            return
        request = self._request_live(self._live)
        crop = request.crop(self._live.camera.height)
        job = RenderJob(request.codes, crop.camera, LIVE, shadow=True)

        def rendered(frame: Frame) -> None:
            if self.following:
                self.display(frame, crop, "fit")

        ended = self._jobs.reporting("Cannot show the search")
        self._jobs.submit(Job("fit view", lambda: self._jobs.frames(job), rendered, ended, urgent=True))

    def _show_chosen(self) -> None:
        """Show an object that a person has chosen, also if it is the one that the view showed before the fit."""
        if self.following:
            self.unfollow()
        self.framing.keep_size(self.settings.panel)

    def _refresh(self) -> None:
        """Show the scene, or the fit, as it is now. An edit of codes ends following a fit."""
        if self.following:
            self._render_live()
        elif self.source == "fit":
            self.source = "scene"
        self.render()

    # On the way

    def _submit(
        self,
        request: ViewRequest,
        detail: int,
        stages: tuple[int, ...] = (1,),
        urgent: bool = False,
        continues: bool = False,
    ) -> None:
        """Render so many px along the view's shorter side.

        Args:
            continues: it is one stage more of the image on screen.
        """
        crop, before = request.crop(detail), self.times if continues else ()
        render = RenderSettings(request.settings.quality.samples, stages)
        job = RenderJob(request.codes, crop.camera, render, shadow=True)

        def rendered(frame: Frame) -> None:
            earlier = self.times if self.full_frame and self.full_frame[1] is crop else before
            self.times = (*earlier, (frame.resolution, frame.seconds + (before[-1][1] if before else 0.0)))
            self._show(frame, crop)
            self.sharp = frame.final and detail == request.full
            if urgent and frame.stage == 0:
                self.budget.observe(stages[0], frame.seconds)
            if urgent and frame.final and not self.sharp:
                self._last_render = time.monotonic()

        ended = self._jobs.reporting("Cannot render the object")
        share = 1.0 if urgent else SHARPENING_SHARE
        self._jobs.submit(Job("view", lambda: self._jobs.frames(job), rendered, ended, urgent, share))

    def _show(self, frame: Frame, crop: orbit.PanelCrop) -> None:
        self.full_frame, self.frame, self.sharp = (frame, crop), crop.cropped(frame), False
        self.baked_frame = None


def _picture(request: ViewRequest) -> str:
    return f"view {digest(request.codes, request.camera)}"
