"""The paint of the object in the view: colours of its parts, measured and changed on the worker."""

from collections.abc import Iterator
from typing import NamedTuple

import torch

from core.detail.paint import Paint, paint_parts
from core.models.model import Instance
from core.models.paints import Rgb
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import BACKGROUND_WEIGHT, Jobs
from viewer.services.messages import MessageKind
from viewer.services.worker import Job


class _Choice(NamedTuple):
    """A paint for an object."""

    instance: Instance  # before the drag over colours
    paint: Paint
    gesture: str  # name of the drag

    def suits(self, instance: Instance) -> bool:
        """Return whether the paint suits another object: one of the same texture code, in any shape and paint."""
        return torch.equal(self.instance.codes.texture, instance.codes.texture)


class Painting:
    """Paints parts of the object, each drag over colours in one step."""

    def __init__(self, jobs: Jobs, editor: Editor, viewport: Viewport) -> None:
        self._jobs = jobs
        self._editor = editor
        self._viewport = viewport
        self._part = ""  # chosen part
        self._drag: _Choice | None = None  # the latest choice of a drag in progress
        self._drags = 0  # their number so far
        self._due: tuple[_Choice, ...] = ()  # that the object does not have yet; it is being painted with the first
        self._measured: tuple[Instance, str, Rgb | None] | None = None  # object, part, and the part's colour if known

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
        """The part's colour, sRGB 0..1: the chosen one, else None until it is measured.

        It is measured once there is a frame. None for an object without a surface; in another shape, the colour of
        before.
        """
        instance = self._editor.scene.instance
        part = self.part
        chosen = [due.paint.colour for due in self._due if due.paint.part == part and due.suits(instance)]
        if chosen:
            return chosen[-1]
        before, of_part, colour = self._measured or (None, "", None)
        if before != instance or of_part != part:
            is_same = before and of_part == part and before.codes.texture_key == instance.codes.texture_key
            colour = colour if is_same else None
            view = self._viewport
            if view.full_frame and view.frame_request and view.frame_request.instance == instance:
                self._measured = instance, part, colour
                self._measure(instance, part)
        return colour

    def _measure(self, instance: Instance, part: str) -> None:
        """Begin to measure a part's colour in the background."""

        def stream() -> Iterator[Rgb | None]:
            yield (yield from self._jobs.backend.paint_colour(instance, part))

        def keep(colour: Rgb) -> None:
            self._measured = instance, part, colour

        def ended(error: Exception | None) -> None:
            if not isinstance(error, ValueError):  # an object without a surface has no colour
                self._jobs.reporting("Cannot find the paint")(error)

        self._jobs.submit(Job("paint colour", stream, keep, ended, weight=BACKGROUND_WEIGHT))

    @property
    def is_original(self) -> bool:
        """True if the object has its original paint: its photo's or, without a photo, object A's."""
        return self._editor.scene.instance == self._original

    @property
    def _original(self) -> Instance:
        """The object in its original paint."""
        instance = self._editor.scene.instance
        return instance.with_texture(instance.fitted if instance.detail else self._editor.original)

    def restore(self) -> None:
        """Restore the original paint."""
        self._set_due(())
        self._editor.edit(self._original)

    def paint(self, colour: Rgb) -> None:
        """Paint the part in a colour, sRGB 0..1, as part of a drag over colours; then call :meth:`release`.

        A colour that comes before the last one is on the object takes its place.
        """
        paint = Paint(colour, self.part)
        if self._drag and self._drag.paint == paint:
            return
        self._drags += self._drag is None
        instance = self._drag.instance if self._drag else self._editor.scene.instance
        self._drag = _Choice(instance, paint, f"paint {self._drags}")
        waiting = (due for due in self._due[1:] if due.paint.part != paint.part)
        self._set_due((*self._due[:1], *waiting, self._drag))

    def release(self) -> None:
        """End a drag over colours, a step of undo."""
        if self._drag and not self._due:
            self._editor.end_gesture()
        self._drag = None

    def close(self) -> None:
        """Stop painting."""
        self._drag = None
        self._set_due(())
        self._jobs.cancel("paint colour")

    def _set_due(self, due: tuple[_Choice, ...]) -> None:
        """Set the paints that the object is about to take, in order."""
        before = self._due[:1]
        self._due = due
        if due[:1] != before:
            self._jobs.cancel("paint")
            if due:
                self._begin(due[0])

    def _begin(self, choice: _Choice) -> None:
        """Begin to paint the object; one that is reshaped meanwhile takes the paint, too."""
        editor = self._editor
        instance = editor.scene.instance

        def stream() -> Iterator[Instance | None]:
            yield (yield from self._jobs.backend.paint(instance, choice.paint))

        def keep(painted: Instance) -> None:
            states = (editor.state, *editor.history.past)
            if not any(state.scene.instance is choice.instance for state in states):
                return  # undone meanwhile
            if not choice.suits(editor.scene.instance):
                self._jobs.messages.notify("The paint was left out, as you had gone on: paint again", MessageKind.NOTE)
                return
            editor.edit(editor.scene.instance.with_texture(painted), choice.gesture)
            self._jobs.cancel("paint colour")  # of the object before
            self._measured = editor.scene.instance, choice.paint.part, choice.paint.colour

        def ended(error: Exception | None) -> None:
            self._jobs.reporting("Cannot paint")(error)
            self._set_due(self._due[1:])
            if not self._due and self._drag is None:
                editor.end_gesture()

        self._jobs.submit(Job("paint", stream, keep, ended, urgent=True))
