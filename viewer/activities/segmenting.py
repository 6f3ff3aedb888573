"""A photo whose object a person points out: a box, strokes, and the place in the frame, segmented while they change."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image

from core.geometry.pixels import to_bytes
from core.models.model import Model
from core.photos.decode import read_rgba
from core.photos.photo import Crop, prepare_photo
from core.photos.segmentation import CutOut, Hints, cut_out
from core.photos.view_bank import ViewBank
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.messages import error_text
from viewer.services.worker import Job
from viewer.values.fit_history import PhotoSource

_SHOWN = 640  # px: the longer side of what is shown
_SMALL = 160  # px: that of the other masks
_DIMMED = 0.25  # what is left of the background's light


@dataclass(frozen=True, eq=False)
class Segmentation:
    """The result of hints and crop."""

    hints: Hints
    found: CutOut
    shown: UInt8[np.ndarray, "height width 3"]  # the photo with its background darkened
    others: tuple[UInt8[np.ndarray, "h w 3"], ...] = ()  # the next masks, shown small in the same way
    cropped: UInt8[np.ndarray, "size size 3"] | None = None  # as it will be fitted; None until that is known
    crop: Crop | None = None  # where the object is in that


class Segmenting:
    """At most one photo at a time. The newest segmentation wins, and every one that is begun is shown."""

    def __init__(self, jobs: Jobs, editor: Editor, fit: Callable[..., bool]) -> None:
        """``fit`` takes photo sources, and returns whether the fit of these has begun."""
        self._jobs, self._editor, self._fit = jobs, editor, fit
        self.close()

    def close(self) -> None:
        """Leave everything as it was."""
        self._jobs.cancel("segmentation")
        self.active = False
        self.sources: tuple[PhotoSource, ...] = ()
        self.index = 0
        self.plain: np.ndarray | None = None  # the photo as it is, on white; None until it has been read
        self.hints, self.crop = Hints(), Crop()
        self.past: tuple[Hints, ...] = ()  # what :meth:`undo` goes back to
        self.result: Segmentation | None = None  # the newest; None where there is none
        self.problem = ""  # why there is none
        self._image: Image.Image | None = None

    def open(self, sources: tuple[PhotoSource, ...], index: int, model: str = "") -> None:
        """Begin with one of the photos of an object, and with what was pointed out in it before.

        Args:
            model: fingerprint of the model to fit; empty: that of the photo's category.
        """
        self.close()
        self._insists, self._model = model, self._jobs.models[model or self._editor.scene.codes.model]
        source = sources[index]
        self.active, self.sources, self.index = True, sources, index
        self.hints, self.crop = source.hints or Hints(), source.crop or Crop()

        def read(image: Image.Image) -> None:
            self._image, self.plain = image, _on_white(image, _SHOWN)
            self._start()

        def ended(error: Exception | None) -> None:
            if error:
                self.close()
                self._jobs.messages.report("Cannot open this image", error)

        self._jobs.submit(Job("segmentation", lambda: (read_rgba(source.path),), read, ended))

    @property
    def settled(self) -> bool:
        """The result belongs to the hints and to the place in the frame as they are now."""
        result = self.result
        return bool(result and result.cropped is not None and (result.hints, result.crop) == (self.hints, self.crop))

    def begin_change(self) -> None:
        """Begin a step for :meth:`undo`, which lasts until the next call."""
        if not self.past or self.past[-1] != self.hints:
            self.past = (*self.past, self.hints)

    def set_hints(self, hints: Hints) -> None:
        """Point out where the object is."""
        if hints != self.hints:
            self.hints = hints
            self._start()

    def choose(self, number: int) -> None:
        """Take one of the other masks that were found, the best of them being 0."""
        chosen = self.hints.choice
        self.begin_change()
        self.set_hints(replace(self.hints, choice=number if number < chosen else number + 1, strokes=()))

    def undo(self) -> None:
        """Back to before the last box or stroke."""
        while self.past:
            before, self.past = self.past[-1], self.past[:-1]
            if before != self.hints:
                self.set_hints(before)
                return

    def set_crop(self, crop: Crop) -> None:
        """Move and scale the object in its frame."""
        if crop != self.crop:
            self.crop = crop
            self._start()

    def fit(self) -> None:
        """Fit the photos, this one as it was segmented; stays open while another fit runs."""
        source = self.sources[self.index]._replace(hints=self.hints or None, crop=self.crop)
        if self._fit(*self.sources[: self.index], source, *self.sources[self.index + 1 :], model=self._insists):
            self.close()

    def _start(self) -> None:
        image, hints, crop, known, model = self._image, self.hints, self.crop, self.result, self._model
        if image is None:
            return
        banks = self._jobs.banks

        def stream() -> Iterator[Segmentation | None]:
            result = known if known and known.hints == hints else _segment(image, hints)
            if not banks.is_built(model):
                yield result
            yield _cropped(result, model, (yield from banks.wait(model)), crop)

        def keep(result: Segmentation) -> None:
            self.result, self.problem = result, ""

        def ended(error: Exception | None) -> None:
            if isinstance(error, ValueError):
                self.result, self.problem = None, error_text(error)
            elif error:
                self._jobs.messages.report("Cannot segment the photo", error)

        self._jobs.submit(Job("segmentation", stream, keep, ended, urgent=True))


def _segment(image: Image.Image, hints: Hints) -> Segmentation:
    found, shown = cut_out(image, hints), _on_white(image, _SHOWN)
    small = _on_white(image, _SMALL)
    others = tuple(_dimmed(small, other.mask) for other in found.others)
    return Segmentation(hints, found, _dimmed(shown, found.mask), others)


def _dimmed(
    shown: UInt8[np.ndarray, "height width 3"], mask: Bool[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "height width 3"]:
    """With its background darkened."""
    inside = np.asarray(Image.fromarray(mask).resize(shown.shape[1::-1]))
    return (shown * np.where(inside[..., None], 1, _DIMMED)).astype(np.uint8)


def _cropped(result: Segmentation, model: Model, bank: ViewBank, crop: Crop) -> Segmentation:
    photo = prepare_photo(result.found, model, bank, crop=crop)
    pixels = to_bytes(photo.pixels)
    return replace(result, cropped=pixels, crop=crop)


def _on_white(image: Image.Image, side: int) -> UInt8[np.ndarray, "height width 3"]:
    """As it is shown."""
    small = image.copy()
    small.thumbnail((side, side))
    return np.asarray(Image.alpha_composite(Image.new("RGBA", small.size, "white"), small).convert("RGB"))
