"""The picture in the view: how it is asked for, how large and how fine, and what is on screen."""

from __future__ import annotations

from typing import TYPE_CHECKING

from core.rendering.frame_budget import Pace
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from viewer.services.worker import Job
from viewer.values import orbit
from viewer.values.quality import QUALITIES, USUAL, Quality

if TYPE_CHECKING:
    from viewer.session import Session

_ACROSS = 2
"""Pixels drawn across each pixel of the finished picture."""


class Viewport:
    """Draws the session's scene, coarse to fine. Nothing here is an edit, so there is nothing to undo."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.frame: Frame | None = None
        """the newest picture of the scene"""
        self.drawn: tuple[Frame, orbit.Excerpt] | None = None
        """the whole picture that it is cut from"""
        self.panel = (512, 512)
        """px, the size of the view"""
        self.pan = (0.0, 0.0)
        """how far the object is moved right and down in the view, in shares of its shorter side"""
        self.quality = QUALITIES[USUAL]
        self.times: tuple[tuple[tuple[int, int], float], ...] = ()
        """of the picture on screen: size (px) of each stage so far, and s from the wish to it"""
        self.pace = Pace()

    def clear(self) -> None:
        """Nothing is on screen: another model is open."""
        self._session.worker.cancel("view")
        self.frame = self.drawn = None

    def resize(self, width: int, height: int) -> None:
        """The view has another size."""
        if (width, height) != self.panel and min(width, height) > 0:
            self.panel = width, height
            self.render()

    def push(self, across: float, down: float) -> None:
        """Move the object aside in the view."""
        self.pan = orbit.pushed(self.pan, across, down)
        self.render()

    def set_quality(self, quality: Quality) -> None:
        """Finish pictures faster, or finer."""
        self.quality = quality
        self.render()

    def render(self) -> None:
        """Ask for a picture of the scene; the newest wish wins. While the film plays, it draws, and so does a fit
        while it is followed.
        """
        session, model = self._session, self._session.model
        if model is None or session.history is None or session.film.playing:
            return
        if self.frame and self.frame is session.fitting.live and session.fitting.followed:
            return
        excerpt = orbit.filling(session.scene.camera, *self.panel, self.quality.detail, self.pan)
        stages = self.pace.stages
        settings = RenderSettings(self.quality.samples, stages, across=_ACROSS)
        job = RenderJob(session.scene.codes, excerpt.camera, settings)

        def drawn(frame: Frame) -> None:
            earlier = self.times if self.drawn and self.drawn[1] is excerpt else ()
            self.times = (*earlier, (frame.resolution, frame.seconds))
            self.put(frame, excerpt)
            if frame.stage == 0:
                self.pace.seen(stages[0], frame.seconds)

        ended = session.reporting("Cannot draw the object")
        session.worker.submit(Job("view", lambda: session.streams.frames(model, job), drawn, ended, urgent=True))

    def put(self, frame: Frame, excerpt: orbit.Excerpt) -> None:
        """Show a picture."""
        self.drawn, self.frame = (frame, excerpt), excerpt.cropped(frame)
