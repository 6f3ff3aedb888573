"""Small pictures of any codes from any camera, drawn beside everything else and kept for a while."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.model import Model
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from viewer.services.worker import Job

if TYPE_CHECKING:
    from viewer.session import Session

_SETTINGS = RenderSettings(samples=40, stages=(1,))
_KEPT = 600
"""pictures: of 64 px they take 45 kB each"""
_AT_ONCE = 6
"""pictures drawn before it is looked again at which are wanted"""
_SHARE = 0.3
"""of the worker's time"""


class _Still(NamedTuple):
    """Of codes by their numbers, so that equal ones share a picture."""

    shape: bytes
    texture: bytes
    camera: Camera


class Stills:
    """What is asked for in a frame is drawn by the worker; what is asked for no more, and not begun, is not."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._pictures: OrderedDict[_Still, Frame] = OrderedDict()
        self._wanted: dict[_Still, RenderJob] = {}

    def picture(self, codes: Codes, camera: Camera, soon: bool = False) -> Frame | None:
        """The picture at the camera's size; None until it is drawn. To be asked for in every frame that shows it.

        Args:
            soon: before the others, as someone waits for it.
        """
        still = _Still(codes.shape.cpu().numpy().tobytes(), codes.texture.cpu().numpy().tobytes(), camera)
        if still in self._pictures:
            self._pictures.move_to_end(still)
            return self._pictures[still]
        wanted = {still: RenderJob(codes, camera, _SETTINGS)}
        self._wanted = wanted | self._wanted if soon else self._wanted | wanted
        return None

    @property
    def drawn(self) -> int:
        """Pictures that are kept."""
        return len(self._pictures)

    def clear(self) -> None:
        """Keep no picture: they are of another model."""
        self._session.worker.cancel("stills")
        self._pictures.clear()
        self._wanted.clear()

    def tick(self) -> None:
        """Once a frame: begin with what was asked for since the last time."""
        wanted, self._wanted = list(self._wanted.items())[:_AT_ONCE], {}
        model = self._session.model
        if wanted and model and not self._session.worker.busy("stills"):
            job = Job(
                "stills",
                lambda: self._drawn(model, wanted),
                self._keep,
                self._session.reporting("Cannot draw the small pictures"),
                share=_SHARE,
            )
            self._session.worker.submit(job)

    def _drawn(self, model: Model, wanted: list[tuple[_Still, RenderJob]]) -> Iterator[tuple[_Still, Frame] | None]:
        for still, job in wanted:
            for frame in self._session.streams.frames(model, job):
                yield (still, frame) if frame else None

    def _keep(self, drawn: tuple[_Still, Frame]) -> None:
        self._pictures[drawn[0]] = drawn[1]
        while len(self._pictures) > _KEPT:
            self._pictures.popitem(last=False)
