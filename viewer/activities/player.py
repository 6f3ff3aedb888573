"""The timeline being made: its keys, where it stands, and playing it in the view."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from core.export.keyframes import Shot, Timeline
from core.models.model import Model
from core.models.scene import Scene
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from viewer.services.worker import Job
from viewer.values import orbit

if TYPE_CHECKING:
    from viewer.session import Session

_PLAYING = "film"
"""the gesture of playing and scrubbing, so that either is one step of undo"""
_RATE = 12.0
"""pictures a second while it plays: on two cores about as many as can be drawn of shapes that change"""
_DETAIL = 128
"""px along the shorter side"""
_SETTINGS = RenderSettings(samples=96, stages=(1,))
_KEPT = 720
"""pictures: a minute"""


class Film:
    """Edits the timeline in the session's state, and shows in the view what it holds at a time.

    While it plays, its pictures are drawn ahead and kept, so that it runs smoothly from the second time round.
    """

    def __init__(self, session: Session, clock: Callable[[], float] = time.monotonic) -> None:
        self._session, self._clock = session, clock
        self.seconds = 0.0
        """where it stands"""
        self._began: float | None = None
        """s on the clock when it stood at 0, while it plays"""
        self._last: Scene | None = None
        self._played: Timeline | None = None
        """what it showed while it plays, and of which film; another scene or film is another edit"""
        self._pictures: dict[int, tuple[Frame, orbit.Excerpt]] = {}
        """by their number, of :attr:`_drawn_of`"""
        self._drawn_of: tuple[Timeline, object] | None = None

    @property
    def timeline(self) -> Timeline:
        """What is edited here. Only once a model is there."""
        return self._session.state.timeline

    @property
    def playing(self) -> bool:
        """It goes on by itself."""
        return self._began is not None

    @property
    def key(self) -> int | None:
        """The key it stands on, if any."""
        return self.timeline.nearest(self.seconds)

    def play(self) -> None:
        """Go on from where it stands; from the beginning if that is the end."""
        if not self.timeline.keys:
            return
        if not self.timeline.loop and self.seconds >= self.timeline.length - 1e-3:
            self.seconds = 0.0
        self._session.settle()
        self._began = self._clock() - self.seconds
        self._show()
        self._draw_ahead()

    def pause(self) -> None:
        """Stay where it stands."""
        if self.playing:
            self._stop()
            self._session.settle()

    def seek(self, seconds: float) -> None:
        """Stand at another time, and show it; to be ended by :meth:`Session.settle`."""
        self._stop()
        self.seconds = max(0.0, min(self.timeline.length, seconds))
        if self.timeline.keys:
            self._show()

    def tick(self) -> None:
        """Once a frame: go on, if it plays. Any other edit stops it."""
        if self._began is None:
            return
        if self._session.scene is not self._last or self.timeline is not self._played:
            self._stop()
            return
        if self._drawn_of != (self.timeline, self._place):
            self._draw_ahead()
        length = self.timeline.length
        passed = self._clock() - self._began
        self.seconds = passed % length if self.timeline.loop else min(passed, length)
        self._show()
        if picture := self._picture():
            self._session.viewport.put(*picture)
        if passed >= length and not self.timeline.loop:
            self.pause()
        self._session.worker.wake()

    def add_key(self) -> None:
        """What is shown becomes a key at this time, in place of one that is there."""
        self.pause()
        here = self.key
        if here is None:
            self._session.retime(self.timeline.added(self.seconds, self._shown))
            self.seconds = min(self.seconds, self.timeline.keys[-1].seconds)  # a loop has no key at its very end
        else:
            self.replace_key(here)

    def replace_key(self, index: int) -> None:
        """What is shown takes the place of a key."""
        self.pause()
        self._session.retime(self.timeline.replaced(index, self._shown))

    def remove_key(self, index: int) -> None:
        """Take a key out."""
        self.pause()
        self._session.retime(self.timeline.removed(index))

    def move_key(self, index: int, seconds: float) -> None:
        """Give a key another time; to be ended by :meth:`Session.settle`."""
        moved = self.timeline.moved(index, seconds)
        self._stop()
        self.seconds = moved.keys[index].seconds
        self._session.retime(moved, f"key {index}")

    def go_to_key(self, index: int) -> None:
        """Stand on a key and show it."""
        self.seek(self.timeline.keys[index].seconds)
        self._session.settle()

    def stretch(self, length: float) -> None:
        """Make it last longer or shorter; to be ended by :meth:`Session.settle`."""
        share = self.seconds / self.timeline.length
        stretched = self.timeline.stretched(length)
        self._stop()
        self.seconds = share * stretched.length
        self._session.retime(stretched, "film length")

    def set_loop(self, loop: bool) -> None:
        """Go on from the last key to the first, or end."""
        self.pause()
        self._session.retime(self.timeline.looped(loop))

    def set_turns(self, turns: int) -> None:
        """Let the camera go round so many times more."""
        self.pause()
        self._session.retime(replace(self.timeline, turns=turns))

    def set_smooth(self, smooth: bool) -> None:
        """Go through the keys without corners, or straight from one to the next."""
        self.pause()
        self._session.retime(replace(self.timeline, smooth=smooth))

    def toggle(self) -> None:
        """Play, or pause."""
        self.pause() if self.playing else self.play()

    def rewind(self) -> None:
        """Stand at the beginning: another model's film is none of this one's."""
        self._began, self.seconds, self._drawn_of = None, 0.0, None
        self._pictures.clear()
        self._session.worker.cancel("film")

    def _stop(self) -> None:
        if self._began is not None:
            self._began = None
            self._session.worker.cancel("film")
            self._session.viewport.render()

    def _picture(self) -> tuple[Frame, orbit.Excerpt] | None:
        """The newest picture that is there, of this moment or before."""
        now = int(self.seconds * _RATE)
        return next((self._pictures[index] for index in range(now, -1, -1) if index in self._pictures), None)

    def _draw_ahead(self) -> None:
        """Draw the pictures that are not there, from this moment on and once round."""
        session, timeline, model = self._session, self.timeline, self._session.model
        assert model is not None, "no model yet"
        place = self._place
        if self._drawn_of != (timeline, place):
            self._drawn_of = timeline, place
            self._pictures.clear()
        count, now = timeline.count(_RATE), int(self.seconds * _RATE)
        if count > _KEPT:  # too long to keep all of it: only what comes next
            self._pictures.clear()
        order = [index for index in (*range(now, count), *range(now)) if index not in self._pictures][:_KEPT]

        def drawn(model: Model) -> Iterator[tuple[int, Frame, orbit.Excerpt] | None]:
            for index in order:
                shot = timeline.at(index / _RATE)
                excerpt = orbit.filling(shot.camera, *place)
                for frame in session.streams.frames(model, RenderJob(shot.codes, excerpt.camera, _SETTINGS)):
                    yield (index, replace(frame, stages=2), excerpt) if frame else None  # a preview

        session.worker.submit(
            Job("film", lambda: drawn(model), self._keep, self._session.reporting("Cannot draw the film"))
        )

    def _keep(self, drawn: tuple[int, Frame, orbit.Excerpt]) -> None:
        index, frame, excerpt = drawn
        self._pictures[index] = frame, excerpt

    @property
    def _place(self) -> tuple[int, int, int, tuple[float, float]]:
        """How its pictures lie in the view: what :func:`viewer.values.orbit.filling` takes."""
        return *self._session.viewport.panel, _DETAIL, self._session.viewport.pan

    @property
    def _shown(self) -> Shot:
        return Shot(self._session.scene.codes, self._session.scene.camera)

    def _show(self) -> None:
        shot = self.timeline.at(self.seconds)
        self._session.visit(shot.codes, shot.camera, gesture=_PLAYING)
        self._last, self._played = self._session.scene, self.timeline
