"""The paint of the object in the view: colours of its parts, measured and changed on the worker."""

from collections.abc import Iterator

import torch
from torch import Tensor

from core.detail.paint import Paint, Rgb, paint_parts
from core.models.codes import Codes
from viewer.editor import Editor
from viewer.services.jobs import BACKGROUND_SHARE, Jobs
from viewer.services.messages import MessageKind
from viewer.services.worker import Job


class Painting:
    """Paints a part. A drag over colours is one step of undo, of which the newest colour counts."""

    def __init__(self, jobs: Jobs, editor: Editor) -> None:
        self._jobs, self._editor = jobs, editor
        self._part = ""  # chosen part
        self._begun = self._shown = editor.scene.codes  # codes before the current drag, and after its newest colour
        self._wanted: Rgb | None = None  # newest colour of the last drag
        self._known: tuple[Codes, str, Rgb | None] | None = None  # codes, part, and the part's colour once measured
        self._released = True  # no drag is in progress

    @property
    def parts(self) -> tuple[str, ...]:
        """The parts that can be painted, the usual one first."""
        return paint_parts(self._editor.model)

    @property
    def part(self) -> str:
        """The part to paint; "" if the object has none."""
        return self._part if self._part in self.parts else next(iter(self.parts), "")

    @part.setter
    def part(self, part: str) -> None:
        self._part = part

    @property
    def colour(self) -> Rgb | None:
        """The part's colour, sRGB 0..1, measured in the background.

        Until it is measured, the last known colour; None if there is none.
        """
        codes, part = self._editor.scene.codes, self.part
        if self._wanted is not None and codes is self._shown:
            return self._wanted
        if self._known is None or self._known[0] != codes or self._known[1] != part:
            before = self._known[2] if self._known else None
            self._known = codes, part, before
            measure, model = self._jobs.backend.paint_colour, self._editor.model

            def stream() -> Iterator[Rgb | None]:
                yield (yield from measure(model, codes, part))

            def keep(colour: Rgb) -> None:
                self._known = codes, part, colour

            def ended(error: Exception | None) -> None:
                if not isinstance(error, ValueError):  # an object without a surface has no colour
                    self._jobs.reporting("Cannot find the paint")(error)

            self._jobs.submit(Job("paint colour", stream, keep, ended, share=BACKGROUND_SHARE))
        return self._known[2]

    @property
    def is_original(self) -> bool:
        """True if the object has its original paint: its photo's or, without a photo, object A's."""
        return bool((self._editor.code("texture") == self._original).all())

    @property
    def _original(self) -> Tensor:
        codes = self._editor.scene.codes
        return codes.detail.texture if codes.detail else self._editor.original.texture

    def restore(self) -> None:
        """Restore the original paint."""
        self._editor.set_texture(self._original)

    def paint(self, colour: Rgb) -> None:
        """Begin to give the part a colour, sRGB 0..1; until :meth:`release`, further colours join the step."""
        if self._released or self._editor.scene.codes is not self._shown:
            self._begun = self._shown = self._editor.scene.codes
            self._editor.end_gesture()
        self._wanted, self._released = colour, False
        begun, wanted, model = self._begun, Paint(colour, self.part), self._editor.model

        def stream() -> Iterator[Codes | None]:
            yield (yield from self._jobs.backend.paint(model, begun, wanted))

        def keep(found: Codes) -> None:
            states = (self._editor.state, *self._editor.history.past)
            if not any(state.scene.codes is self._shown for state in states):
                return  # undone meanwhile
            if not torch.equal(self._editor.code("texture"), self._shown.texture):
                self._jobs.messages.notify("The paint was left out, as you had gone on: paint again", MessageKind.NOTE)
                return
            self._editor.set_texture(found.texture, gesture="paint")
            self._shown = self._editor.scene.codes
            self._jobs.cancel("paint colour")  # of the codes before
            self._known = self._shown, wanted.part, colour

        def ended(error: Exception | None) -> None:
            self._jobs.reporting("Cannot paint")(error)
            self._end()

        self._jobs.submit(Job("paint", stream, keep, ended, urgent=True))

    def release(self) -> None:
        """End the drag; the next colour is another step of undo."""
        if not self._released:
            self._released = True
            self._end()

    def _end(self) -> None:
        if self._released and not self._jobs.busy("paint"):
            self._editor.end_gesture()
