"""The objects at hand: those the model was trained on, and those added since; with small pictures of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from core.models.codes import Codes
from core.models.model import Model
from core.photos.photo import Photo
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from viewer.services.worker import Job
from viewer.values import orbit

if TYPE_CHECKING:
    from viewer.session import Session

_SIZE = 64
"""px"""
_SETTINGS = RenderSettings(samples=40, stages=(1,))


@dataclass(frozen=True, eq=False)
class Thing:
    """An object that can be shown and mixed."""

    name: str
    codes: Codes
    photo: Photo | None = None
    """what it was fitted to, if it was"""


class Gallery:
    """Objects by name. Their pictures are drawn on the worker, once, when they are first asked for."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._things: dict[str, Thing] = {}
        self._own = 0
        self._pictures: dict[str, Frame] = {}
        self._asked: set[str] = set()
        self._waiting: deque[str] = deque()

    def __getitem__(self, name: str) -> Thing:
        return self._things[name]

    @property
    def names(self) -> list[str]:
        """Added objects first, the newest in front, then the model's own."""
        names = list(self._things)
        return names[self._own :][::-1] + names[: self._own]

    @property
    def added(self) -> tuple[Thing, ...]:
        """Those that are not the model's own, the oldest first: fitted, or opened."""
        return tuple(self._things.values())[self._own :]

    def open(self, model: Model) -> None:
        """Hold the objects of a model but its broken ones, and nothing else."""
        self._session.worker.cancel("thumbnails")
        self._things, self._pictures, self._asked, self._waiting = {}, {}, set(), deque()
        for index in model.codes.sound:
            self._keep(Thing(model.codes.objects[index].name, model.codes[index]))
        if not self._things:
            self._keep(Thing("mean", model.codes.mean))
        self._own = len(self._things)

    def add(self, thing: Thing) -> str:
        """Take in an object; its name, which is made unique."""
        return self._keep(thing)

    def picture(self, name: str) -> Frame | None:
        """An object's picture; None until it is drawn."""
        if name not in self._asked:
            self._asked.add(name)
            self._waiting.append(name)
            self._draw_waiting()
        return self._pictures.get(name)

    def _draw_waiting(self) -> None:
        model = self._session.model
        if model and self._waiting and not self._session.worker.busy("thumbnails"):
            job = Job("thumbnails", lambda: self._draw(model), self._drawn, self._ended, share=0.2)
            self._session.worker.submit(job)

    def _keep(self, thing: Thing) -> str:
        name, count = thing.name, 1
        while name in self._things:
            count += 1
            name = f"{thing.name} ({count})"
        self._things[name] = replace(thing, name=name)
        return name

    def _draw(self, model: Model) -> Iterator[tuple[str, Frame] | None]:
        camera, waiting = orbit.home(model).resized(_SIZE, _SIZE), self._waiting
        while waiting:
            name = waiting.popleft()
            for frame in self._session.streams.frames(model, RenderJob(self._things[name].codes, camera, _SETTINGS)):
                yield (name, frame) if frame else None

    def _drawn(self, drawn: tuple[str, Frame]) -> None:
        self._pictures[drawn[0]] = drawn[1]

    def _ended(self, error: Exception | None) -> None:
        if error:
            self._session.report("Cannot draw the thumbnails", error)
        self._draw_waiting()
