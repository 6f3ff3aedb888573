"""A photo whose object a person points out: a box, strokes, and the place in the frame, cut out while they change."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import UInt8
from PIL import Image

from core.models.model import Model
from core.photos.decode import read_rgba
from core.photos.photo import Framing, framed
from core.photos.segmentation import CutOut, Hints, cut_out
from viewer.services.messages import explain
from viewer.services.worker import Job
from viewer.values.fit_history import Source

if TYPE_CHECKING:
    from viewer.session import Session

_SHOWN = 640
"""px: the longer side of what is shown"""
_DARK = 0.25
"""what is left of the ground's light"""


@dataclass(frozen=True, eq=False)
class Cut:
    """What hints and framing have come to."""

    hints: Hints
    cut: CutOut
    shown: UInt8[np.ndarray, "height width 3"]
    """the photo with its ground darkened"""
    framed: UInt8[np.ndarray, "size size 3"] | None = None
    """as it will be fitted; None until that is known"""


class Cutting:
    """At most one photo at a time. The newest cut-out wins, and every one that is begun is shown."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.close()

    def close(self) -> None:
        """Leave everything as it was."""
        self._session.worker.cancel("cut out")
        self.active = False
        self.sources: tuple[Source, ...] = ()
        self.index = 0
        self.plain: np.ndarray | None = None
        """the photo as it is, on white; None until it has been read"""
        self.hints, self.framing = Hints(), Framing()
        self.past: tuple[Hints, ...] = ()
        """what :meth:`undo` goes back to"""
        self.cut: Cut | None = None
        """the newest; None where there is none"""
        self.problem = ""
        """why there is none"""
        self._image: Image.Image | None = None

    def open(self, sources: tuple[Source, ...], index: int) -> None:
        """Begin with one of the photos of an object, and with what was pointed out in it before."""
        self.close()
        source = sources[index]
        self.active, self.sources, self.index = True, sources, index
        self.hints, self.framing = source.hints or Hints(), source.framing or Framing()

        def read(image: Image.Image) -> None:
            self._image, self.plain = image, _on_white(image)
            self._begin()

        def ended(error: Exception | None) -> None:
            if error:
                self.close()
                self._session.report("Cannot open this image", error)

        self._session.worker.submit(Job("cut out", lambda: (read_rgba(source.path),), read, ended))

    def begin_change(self) -> None:
        """What follows, up to the next call, is one step for :meth:`undo`."""
        if not self.past or self.past[-1] != self.hints:
            self.past = (*self.past, self.hints)

    def point(self, hints: Hints) -> None:
        """Say where the object is."""
        if hints != self.hints:
            self.hints = hints
            self._begin()

    def undo(self) -> None:
        """Back to before the last box or stroke."""
        while self.past:
            before, self.past = self.past[-1], self.past[:-1]
            if before != self.hints:
                self.point(before)
                return

    def frame(self, framing: Framing) -> None:
        """Move and scale the object in its frame."""
        if framing != self.framing:
            self.framing = framing
            self._begin()

    def fit(self) -> None:
        """Fit the photos, this one as it was cut out; not beside another fit, which would leave it open."""
        if self._session.fitting.running:
            self._session.say("A fit is under way: stop it first")
            return
        told = self.sources[self.index]._replace(hints=self.hints or None, framing=self.framing)
        sources = (*self.sources[: self.index], told, *self.sources[self.index + 1 :])
        self.close()
        self._session.fitting.fit(*sources)

    def _begin(self) -> None:
        model, image, hints, framing, known = self._session.model, self._image, self.hints, self.framing, self.cut
        if model is None or image is None:
            return

        def stream() -> Iterator[Cut | None]:
            cut = known if known and known.hints == hints else _cut(image, hints)
            waiting: Cut | None = cut
            for _ in self._session.streams.preparing(model):  # framing needs it, and it may take seconds
                yield waiting
                waiting = None
            yield _framed(cut, model, framing)

        def keep(cut: Cut) -> None:
            self.cut, self.problem = cut, ""

        def ended(error: Exception | None) -> None:
            if isinstance(error, ValueError):
                self.cut, self.problem = None, explain(error)
            elif error:
                self._session.report("Cannot cut the object out", error)

        self._session.worker.submit(Job("cut out", stream, keep, ended, urgent=True))


def _cut(image: Image.Image, hints: Hints) -> Cut:
    found, shown = cut_out(image, hints), _on_white(image)
    mask = np.asarray(Image.fromarray(found.mask).resize(shown.shape[1::-1]))
    return Cut(hints, found, (shown * np.where(mask[..., None], 1, _DARK)).astype(np.uint8))


def _framed(cut: Cut, model: Model, framing: Framing) -> Cut:
    photo = framed(cut.cut, model, framing=framing)
    return replace(cut, framed=(photo.pixels.clamp(0, 1) * 255 + 0.5).to(torch.uint8).numpy())


def _on_white(image: Image.Image) -> UInt8[np.ndarray, "height width 3"]:
    """As it is shown."""
    small = image.copy()
    small.thumbnail((_SHOWN, _SHOWN))
    return np.asarray(Image.alpha_composite(Image.new("RGBA", small.size, "white"), small).convert("RGB"))
