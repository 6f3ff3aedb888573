"""Messages that offer another meaning of the photos that a person opened."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Protocol

from core.fitting.problem import MOST_PHOTOS
from viewer.activities.fit_queue import FitQueue
from viewer.services.messages import Button, MessageKind, Messages, error_text
from viewer.values.fit_history import FitHistory, FitRequest, PhotoSource, Question
from viewer.values.printable import printable

_NAMED = 3  # files that a message names


class _Fits(Protocol):
    """The part of :class:`viewer.activities.fitting.Fitting` that offers act on."""

    @property
    def pending(self) -> tuple[FitRequest, ...]: ...
    def fit_each(self, sources: tuple[PhotoSource, ...]) -> None: ...
    def refine(self, earlier: FitHistory, *added: PhotoSource) -> None: ...
    def withdraw(self, sources: tuple[PhotoSource, ...]) -> None: ...
    def take_over(self, unfinished: FitQueue) -> None: ...


class PhotoOffers:
    """Offers an object each, another photo of the same object, fits of photos left out, or to undo a removal."""

    def __init__(self, fits: _Fits, messages: Messages) -> None:
        self._fits = fits
        self._messages = messages
        self._closed = False  # buttons of messages outlive the session

    def close(self) -> None:
        """Withdraw the offers that do not depend on a fit."""
        self._closed = True

    def fit_otherwise(self, sources: tuple[PhotoSource, ...], finished: FitHistory, note: str) -> None:
        """Offer an object for each photo, or another photo of the finished object shown; ``note`` joins the message."""
        name = finished.name
        if len(sources) > 1:
            text = f"{len(sources)} photos are fitted as one object"
            button = Button("An object each", partial(self._instead, sources, partial(self._fits.fit_each, sources)))
        elif finished.photos and len(finished.sources) < MOST_PHOTOS:
            text = f"{sources[0].name} is fitted as a new object"
            add = partial(self._fits.refine, finished, sources[0])
            button = Button("Another photo of", partial(self._instead, sources, add), name)
        else:
            return
        text = ". ".join(filter(None, (text, note)))
        self._messages.notify(text, MessageKind.NOTE, buttons=(button,), relevant=partial(self._awaits, sources))

    def fit_left_out(self, sources: tuple[PhotoSource, ...]) -> None:
        """Name the photos that a fit left out, and offer to fit an object to each."""
        if sources:
            text = f"Left out, as another object: {', '.join(source.name for source in sources)}"
            label = "Fit by itself" if len(sources) == 1 else "Fit each"
            self._offer(text, Button(label, partial(self._fits.fit_each, sources)), MessageKind.NOTE)

    def undo_removal(self, failed: tuple[Question, ...]) -> None:
        """Offer to bring failed fits back."""
        undo = Button("Undo", partial(self._fits.take_over, FitQueue(questions=failed)))
        self._offer(f"Removed {len(failed)} that could not be fitted", undo, MessageKind.DONE)

    def _offer(self, text: str, button: Button, kind: MessageKind) -> None:
        self._messages.notify(text, kind, buttons=(button,), relevant=lambda: not self._closed)

    def _instead(self, sources: tuple[PhotoSource, ...], fit: Callable[[], None]) -> None:
        """Withdraw the fit of photos, and run another."""
        for request in self._fits.pending:
            if request.history.sources == sources:
                self._fits.withdraw(request.history.sources)
        fit()

    def _awaits(self, sources: tuple[PhotoSource, ...]) -> bool:
        requests = (request for request in self._fits.pending if not request.problem)
        return any(request.history.sources == sources for request in requests)


def describe(problems: dict[Path, ValueError], count: int) -> str:
    """Return a sentence about files that are no photos among ``count`` files; "" for none."""
    if not problems:
        return ""
    if count == 1:
        return f"Cannot fit this image: {error_text(*problems.values())}"
    names = ", ".join(printable(path.name) for path in [*problems][:_NAMED]) + ", …" * (len(problems) > _NAMED)
    return f"{len(problems)} of {count} are no photos: {names}"
