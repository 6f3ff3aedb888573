"""The view: its source, its camera, its rendering, and the frame on screen."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Literal

from core.detail.progressive import Frame, RenderJob, RenderSettings
from core.export.films import View
from core.geometry.camera import Camera
from core.gl.baked_field import BakedField
from core.models.model import Instance
from core.models.scene import Scene
from viewer.activities.frame_budget import FrameBudget
from viewer.activities.framing import Framing
from viewer.activities.thumbnails import digest, frame_of, pixels_of
from viewer.editor import Editor
from viewer.services.jobs import FIT_WEIGHT, SHARPENING_WEIGHT, TILES_WEIGHT, Jobs
from viewer.services.worker import Job
from viewer.store.pictures import Pixels
from viewer.values import orbit
from viewer.values.view_request import ViewRequest, ViewSettings

Source = Literal["none", "scene", "fit"]
LIVE = RenderSettings(samples=48, divisors=(2,))  # for frames of a running fit
_FULL_RESOLUTION_DELAY = 0.4  # s without a change before rendering every pixel of the view
_EXACT_DELAY = 0.15  # s without a change before rendering the exact image in place of OpenGL's


class Viewport:
    """Shows the edited scene, or frames of a running fit.

    The view follows a fit until codes are edited; turning the view does not end that.
    """

    def __init__(self, jobs: Jobs, editor: Editor, settings: ViewSettings) -> None:
        self._jobs = jobs
        self._editor = editor
        self.settings = settings
        self.source: Source = "none"  # source of the displayed frames; none until :meth:`begin`
        self.frame: Frame | None = None  # newest frame, cropped to the view
        self.frame_request: ViewRequest | None = None  # inputs of :attr:`frame`
        self.full_frame: tuple[Frame, orbit.PanelCrop] | None = None  # newest whole frame, and its shown part
        self.repainted: Frame | None = None  # :attr:`full_frame` in a paint that the object does not have yet
        self.sharp = False  # the frame on screen is finished and has every pixel of the view
        self.budget = FrameBudget()
        self.baked: BakedField | None = None  # object that OpenGL can draw, as large as the shown one
        self.baked_frame: orbit.PanelCrop | None = None  # crop of :attr:`baked` on screen; None: the frame is on screen
        self._unstretched: BakedField | None = None  # :attr:`baked` before its size stretched it
        self._baked_of: Instance | None = None  # unstretched object that is baked or being baked
        self._last_orbit = 0.0  # s on the monotonic clock of the last change of :attr:`baked_frame`
        self._last_render: float | None = None  # s on the monotonic clock when a preview was finished
        self._live: View | None = None  # newest object of the fit, from the photo's camera at the model's size
        self._followed_since: Scene | None = None  # scene when following a fit began; None: no fit is followed
        editor.scene_changed.connect(self._refresh)
        self.framing = Framing(jobs, editor)
        editor.object_chosen.connect(self._show_chosen)

    def begin(self, pictures: Mapping[str, Pixels] | None = None) -> None:
        """Begin to render the scene; until then show its stored image in ``pictures``, if any."""
        request = self.request
        if (stored := (pictures or {}).get(_picture(request))) is not None:
            height, width = stored.shape[:2]
            if self.source == "none":  # the view is as large as at the last launch, or says so in its first frame
                self.settings = replace(self.settings, panel=(width, height))
                request = self.request
            crop = orbit.fit_to_panel(request.camera, width, height, min(width, height))
            self._show(frame_of(stored, stages=2), crop, request)
        if self.source == "none":
            self.source = "scene"
        self.render()

    def picture(self) -> Callable[[], dict[str, Pixels]]:
        """Return a function, on any thread, that makes the newest image to store, by its object and camera."""
        frame = self.frame
        request = self.frame_request
        return lambda: {_picture(request): pixels_of(frame)} if frame and request else {}

    @property
    def camera(self) -> Camera:
        """The camera of the view, which may be a followed fit's."""
        return self.request.camera

    @property
    def request(self) -> ViewRequest:
        """The inputs of the current image: the scene or the followed fit, and the settings."""
        scene = self._editor.scene
        live = self._live if self.source == "fit" else None
        return self._request_live(live) if live else ViewRequest(scene.instance, scene.camera, self.settings)

    def _request_live(self, live: View) -> ViewRequest:
        """Return the inputs of a fit's image, from the photo's camera until a person turns the view."""
        camera = self._editor.scene.camera if self.turned else live.camera
        return ViewRequest(live.instance, camera, self.settings)

    def change(self, **settings: Any) -> None:
        """Change fields of :class:`~viewer.values.view_request.ViewSettings`; render again if needed."""
        previous = self.settings
        self.settings = replace(self.settings, **settings)
        as_before = replace(self.settings, mode=previous.mode, opengl=previous.opengl) == previous
        if not as_before or (self.baked_frame and not self.settings.baked):
            self._refresh()
        if self.settings.panel != previous.panel and not self._editor.history.past and not self.following:
            self.framing.keep_size(self.settings.panel)

    def pan_by(self, across: float, down: float) -> None:
        """Move the object right and down, by fractions of the view's shorter side."""
        self.change(pan=orbit.panned(self.settings.pan, across, down))

    def reset_view(self) -> None:
        """Return to the object's first view, that of its photo or the model's, centred and framed."""
        detail = self._editor.scene.instance.detail
        model = self._editor.model
        first = orbit.photo_camera(detail.views[0].camera, model) if detail else orbit.home(model)
        self._editor.set_camera(first)
        self.centre()

    def centre(self) -> None:
        """Centre and frame the object."""
        self.change(pan=(0.0, 0.0))
        self.framing.frame(self.settings.panel)

    def render(self) -> None:
        """Render the scene in place of the current render, unless a fit is shown."""
        if self.source != "scene":
            return
        self._last_render, self.sharp = None, False
        request = self.request
        if self.is_baked(request.instance):
            self._jobs.cancel("view")
            self.baked_frame = request.crop(request.full)
            self._stretch_baked()
            self._last_orbit = time.monotonic()
            return
        self.baked_frame = None
        if self._baked_of not in (None, request.instance.unstretched):
            self._jobs.cancel("bake")
            self.baked = self._baked_of = None
        self._submit(request, request.preview, urgent=True)

    def tick(self) -> None:
        """Bake the object and render the sharp image while nothing changes and no fit runs; call once a frame."""
        now = time.monotonic()
        self.framing.tick(self.settings.panel)
        request = self.request
        if self.source == "scene" and not self._jobs.busy("view"):
            if self.settings.baked:
                self._bake(request.instance.unstretched)
            if self.baked_frame and now - self._last_orbit >= _EXACT_DELAY:
                # at full size, as OpenGL's image already is, unless a fit needs the time
                self._submit(request, request.preview if self._jobs.busy("fit") else request.full)
        rests = self._last_render is not None and now - self._last_render >= _FULL_RESOLUTION_DELAY
        if rests and not self._jobs.busy("fit"):
            self._last_render = None
            self._submit(request, request.full)

    # Baked by core, drawn by OpenGL

    def is_baked(self, instance: Instance) -> bool:
        """Return whether OpenGL can draw an object now."""
        return self.settings.baked and self.baked is not None and instance.unstretched == self._baked_of

    def _stretch_baked(self) -> None:
        """Give the baked object the size of the shown one."""
        proportions = self.request.instance.codes.proportions
        if self.baked and self.baked.proportions != proportions:
            assert self._unstretched is not None
            self.baked = self._unstretched.stretched(proportions)

    def _bake(self, instance: Instance) -> None:
        """Begin to bake an unstretched object, unless it is baked or being baked."""
        if instance == self._baked_of:
            return
        self._baked_of = instance

        def baked(field: BakedField) -> None:
            self.baked = self._unstretched = field
            self._stretch_baked()

        bake = self._jobs.backend.bake
        ended = self._jobs.reporting("Cannot bake the object")
        self._jobs.submit(Job("bake", lambda: bake(instance), baked, ended, weight=TILES_WEIGHT))

    # Frames of a fit

    @property
    def following(self) -> bool:
        """True while a fit is followed: no codes were edited since it began."""
        since = self._followed_since
        return since is not None and self._editor.scene.instance is since.instance

    @property
    def turned(self) -> bool:
        """True if a person has turned the view since following began."""
        since = self._followed_since
        return since is not None and self._editor.scene.camera != since.camera

    def follow(self) -> None:
        """Begin to follow the running fit, from the photo's camera."""
        self._jobs.cancel("framing")
        self._followed_since = self._editor.scene
        self._editor.end_gesture()
        self._render_live()

    def unfollow(self) -> None:
        """Stop following the fit and return to the scene."""
        self._followed_since = self._live = None
        self._jobs.cancel("fit view")
        if self.source == "fit":
            self.source = "scene"
            self.render()

    def show_live(self, newest: View) -> None:
        """Take the fit's newest object, seen from the photo's camera at the model's image size.

        It is rendered unless an earlier one still is, in a share of the time, as that delays the fit.
        """
        self._live = newest
        if not self._jobs.busy("fit view"):
            self._render_live(urgent=False)

    def _render_live(self, urgent: bool = True) -> None:
        """Render the fit's newest object, if a fit is followed."""
        if not (self._live and self.following):
            return
        request = self._request_live(self._live)
        crop = request.crop(self._live.camera.height)
        job = RenderJob(request.instance, crop.camera, LIVE, shadow=True)

        def rendered(frame: Frame) -> None:
            if self.following:
                self.source, self._last_render = "fit", None
                self._jobs.cancel("view")
                self._show(frame, crop, request)

        ended = self._jobs.reporting("Cannot show the search")
        frames = Job("fit view", lambda: self._jobs.backend.frames(job), rendered, ended, urgent, TILES_WEIGHT)
        self._jobs.submit(frames)

    def _show_chosen(self) -> None:
        """Show an object that a person chose: stop following a fit, and frame the object."""
        if self.following:
            self.unfollow()
        self.framing.keep_size(self.settings.panel)

    def _refresh(self) -> None:
        """Render the current scene or followed fit. An edit of codes returns the view to the scene."""
        if self.following:
            self._render_live()
        elif self.source == "fit":
            self.source = "scene"
        self.render()

    # Rendering

    def _submit(self, request: ViewRequest, detail: int, urgent: bool = False) -> None:
        """Submit a render of ``detail`` px along the shorter side; an urgent one is a preview, from coarse to fine."""
        crop = request.crop(detail)
        stages = self.budget.divisors(crop.camera) if urgent else (1,)
        render = RenderSettings(request.settings.samples, stages)
        job = RenderJob(request.instance, crop.camera, render, shadow=True)

        def rendered(frame: Frame) -> None:
            if not self._is_coarser(crop.cropped(frame), request):
                self._show(frame, crop, request)
            elif self.full_frame and request.settings.offset == (0.0, 0.0):  # a stored image has no shadow
                self.full_frame = replace(self.full_frame[0], shadow=frame.shadow), self.full_frame[1]
            self.sharp = frame.final and detail == request.full
            if urgent and frame.stage == 0:
                self.budget.observe(math.prod(frame.resolution), frame.ray_seconds)
            if urgent and frame.final and not self.sharp:
                self._last_render = time.monotonic()

        ended = self._jobs.reporting("Cannot render the object")
        weight = FIT_WEIGHT if urgent else SHARPENING_WEIGHT
        self._jobs.submit(Job("view", lambda: self._jobs.backend.frames(job), rendered, ended, urgent, weight))

    def _is_coarser(self, frame: Frame, request: ViewRequest) -> bool:
        """Return whether the image on screen is a sharper one of the same view, as after a launch."""
        current = self.frame_request
        if current is None or self.frame is None or self.baked_frame:
            return False
        view = current.instance, current.camera, current.settings.pan
        if view != (request.instance, request.camera, request.settings.pan):
            return False
        width, height = self.frame.resolution
        return height > frame.resolution[1] and abs(width / height * frame.resolution[1] - frame.resolution[0]) <= 1

    def _show(self, frame: Frame, crop: orbit.PanelCrop, request: ViewRequest) -> None:
        if request != self.frame_request:  # else a sharper image of the same
            self.repainted = None
        self.full_frame = (frame, crop)
        self.frame = crop.cropped(frame)
        self.sharp = False
        self.frame_request = request
        self.baked_frame = None


def _picture(request: ViewRequest) -> str:
    return f"view {digest(request.instance, request.camera)}"
