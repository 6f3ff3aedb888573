"""The segmentation of a photo by a person's clicks, box and strokes, updated while they change."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image

from core.photos.decode import read_rgba
from core.photos.segmentation import CutOut, Hints, cut_out
from viewer.services.jobs import Jobs
from viewer.services.messages import error_text
from viewer.services.worker import Job
from viewer.values.cut_out_preview import CutOutPreview, pixels_on_white
from viewer.values.fit_history import PhotoSource

_SHOWN = 640  # px of the shown photo's longer side
_SMALL = 160  # px of the longer side of alternative masks
_DIMMED = 0.25  # remaining brightness of the background, 0..1


@dataclass(frozen=True, eq=False)
class Segmentation:
    """The cut-out that hints give, and its images."""

    hints: Hints
    cut: CutOut
    image: UInt8[np.ndarray, "height width 3"]  # the photo with a darkened background
    alternatives: tuple[UInt8[np.ndarray, "h w 3"], ...] = ()  # small images of other masks, the next best first


class Segmenting:
    """Segments one photo at a time. A running segmentation is shown before the newest hints are segmented."""

    def __init__(self, jobs: Jobs, fit: Callable[..., None]) -> None:
        """Fit segmented photos by ``fit``, which is :meth:`Fitting.fit`."""
        self._jobs = jobs
        self._fit = fit
        self.close()

    def close(self) -> None:
        """Close the photo and change nothing."""
        self._jobs.cancel("segmentation")
        self.active = False
        self.sources: tuple[PhotoSource, ...] = ()
        self.index = 0
        self.plain: np.ndarray | None = None  # the photo on white; None until it is read
        self.hints = Hints()
        self.past: tuple[Hints, ...] = ()  # earlier hints, for :meth:`undo`
        self.result: Segmentation | None = None  # the newest segmentation, if any
        self.problem = ""  # reason for a missing result
        self._image: Image.Image | None = None  # RGBA; None until it is read

    def open(self, sources: tuple[PhotoSource, ...], index: int, model: str = "") -> None:
        """Open one of an object's photos, with its hints; an empty ``model`` follows the first photo's category."""
        self.close()
        self._model = model
        source = sources[index]
        self.active = True
        self.sources = sources
        self.index = index
        self.hints = source.hints or Hints()

        def read(image: Image.Image) -> None:
            self._image = image
            self.plain = pixels_on_white(image, _SHOWN)
            self._start()

        def ended(error: Exception | None) -> None:
            if error:
                self.close()
                self._jobs.messages.report("Cannot open this image", error)

        self._jobs.submit(Job("segmentation", lambda: (read_rgba(source.file),), read, ended))

    @property
    def settled(self) -> bool:
        """True if the result belongs to the current hints."""
        return self.result is not None and self.result.hints == self.hints

    def begin_change(self) -> None:
        """Begin a step of :meth:`undo`, which the following :meth:`set_hints` join."""
        if not self.past or self.past[-1] != self.hints:
            self.past = (*self.past, self.hints)

    def set_hints(self, hints: Hints) -> None:
        """Change the hints and segment the photo again."""
        if hints != self.hints:
            self.hints = hints
            self._start()

    def choose(self, number: int) -> None:
        """Choose an alternative mask by its index; strokes are dropped."""
        current = self.hints.choice
        self.begin_change()
        self.set_hints(replace(self.hints, choice=number if number < current else number + 1, strokes=()))

    def undo(self) -> None:
        """Return to the hints before the last step."""
        while self.past:
            previous = self.past[-1]
            self.past = self.past[:-1]
            if previous != self.hints:
                self.set_hints(previous)
                return

    def fit(self) -> None:
        """Fit the photos with the current hints, after a running fit, and close."""
        source = self.sources[self.index]._replace(hints=self.hints)
        sources = (*self.sources[: self.index], source, *self.sources[self.index + 1 :])
        image = self._image
        result = self.result
        confirmed = {}
        if image and result and self.settled:
            confirmed[source] = lambda: (result.cut, CutOutPreview.of(image, result.cut))
        self._fit(*sources, model=self._model, confirmed=confirmed)
        self.close()

    def _start(self) -> None:
        image = self._image
        hints = self.hints
        if image is None:
            return

        def keep(result: Segmentation) -> None:
            self.result = result
            self.problem = ""

        def ended(error: Exception | None) -> None:
            if isinstance(error, ValueError):
                self.result = None
                self.problem = error_text(error)
            elif error:
                self._jobs.messages.report("Cannot segment the photo", error)

        self._jobs.submit(Job("segmentation", lambda: (_segment(image, hints),), keep, ended, urgent=True))


def _segment(image: Image.Image, hints: Hints) -> Segmentation:
    cut = cut_out(image, hints)
    small = pixels_on_white(image, _SMALL)
    alternatives = tuple(_dimmed(small, alternative.mask) for alternative in cut.alternatives)
    return Segmentation(hints, cut, _dimmed(pixels_on_white(image, _SHOWN), cut.mask), alternatives)


def _dimmed(
    pixels: UInt8[np.ndarray, "height width 3"], mask: Bool[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "height width 3"]:
    """Return the image with the background darkened; the mask may have another size."""
    inside = np.asarray(Image.fromarray(mask).resize(pixels.shape[1::-1]))
    return (pixels * np.where(inside[..., None], 1, _DIMMED)).astype(np.uint8)
