"""The objects at hand: those the model was trained on, and those fitted since; with small pictures of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from core.codes import Codes
from core.frames import Frame, RenderJob, RenderSettings
from core.model import Model
from core.photos import Photo
from viewer import orbit
from viewer.worker import Job

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
    """what it was fitted to; None where it is one of the model's own"""


class Gallery:
    """Objects by name. Their pictures are drawn on the worker, a few at a time, once."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._things: dict[str, Thing] = {}
        self.pictures: dict[str, Frame] = {}

    def __getitem__(self, name: str) -> Thing:
        return self._things[name]

    @property
    def names(self) -> list[str]:
        """Fitted objects first, the newest in front, then the model's own."""
        fitted = [name for name, thing in self._things.items() if thing.photo]
        return fitted[::-1] + [name for name, thing in self._things.items() if not thing.photo]

    def open(self, model: Model) -> None:
        """Hold the objects of a model but its broken ones, and nothing else."""
        self._things, self.pictures = {}, {}
        for index in model.codes.sound:
            self._keep(Thing(model.codes.objects[index].name, model.codes[index]))
        if not self._things:
            self._keep(Thing("mean", model.codes.mean))

    def add(self, thing: Thing) -> str:
        """Take in a fitted object; its name, which is made unique."""
        name = self._keep(thing)
        self.draw_missing()
        return name

    def draw_missing(self) -> None:
        """Ask for the pictures that are not there yet."""
        model = self._session.model
        missing = [self._things[name] for name in self.names if name not in self.pictures]
        if model and missing:
            job = Job("thumbnails", lambda: self._draw(model, missing), self._drawn, self._failed, share=0.2)
            self._session.worker.submit(job)

    def _keep(self, thing: Thing) -> str:
        name, count = thing.name, 1
        while name in self._things:
            count += 1
            name = f"{thing.name} ({count})"
        self._things[name] = replace(thing, name=name)
        return name

    def _draw(self, model: Model, things: list[Thing]) -> Iterator[tuple[str, Frame] | None]:
        camera = orbit.home(model).resized(_SIZE, _SIZE)
        for thing in things:
            for frame in self._session.streams.frames(model, RenderJob(thing.codes, camera, _SETTINGS)):
                yield (thing.name, frame) if frame else None

    def _drawn(self, drawn: tuple[str, Frame]) -> None:
        self.pictures[drawn[0]] = drawn[1]

    def _failed(self, error: Exception | None) -> None:
        if error:
            self._session.report("Cannot draw the thumbnails", error)
