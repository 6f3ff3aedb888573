"""The paint of the object in the view: colours of its parts, measured and changed on the worker."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import torch

from core.detail.progressive import Frame
from core.editing.paint import CoarsePaint, Paint, paint_parts
from core.edits.paint import Rgb
from core.models.model import Instance
from viewer.activities.reshaping import Reshaping
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import BACKGROUND_WEIGHT, Jobs
from viewer.services.latest import Latest
from viewer.services.messages import MessageKind
from viewer.services.worker import Job


class _Choice(NamedTuple):
    """A paint for an object."""

    instance: Instance  # before the paint
    paint: Paint

    def suits(self, instance: Instance) -> bool:
        """Return whether the paint suits another object: one of the same texture code, in any shape and paint."""
        return torch.equal(self.instance.codes.texture, instance.codes.texture)


class Painting:
    """Paints parts: during a drag over colours the frame on screen, coarsely, then the object, in one step."""

    def __init__(self, jobs: Jobs, editor: Editor, viewport: Viewport, reshaping: Reshaping) -> None:
        self._jobs = jobs
        self._editor = editor
        self._viewport = viewport
        self._reshaping = reshaping
        self._part = ""  # chosen part
        self.popup_part = ""  # whose colours an open popup shows
        self._largest: tuple[Instance, str] | None = None  # an object as fitted, and its largest part when first seen
        self._drag: _Choice | None = None  # the latest choice of a drag in progress
        self._due: tuple[_Choice, ...] = ()  # that the object does not have yet; it is being painted with the first
        problem = "Cannot show the paint"
        self._coarse = Latest[tuple[Frame, str], CoarsePaint](jobs, "coarse paint", problem, urgent=True)
        problem = "Cannot find the paint"  # but of an object without a surface, which has no colour
        self._measured = Latest[tuple[Instance, str], Rgb](
            jobs, "paint colour", problem, weight=BACKGROUND_WEIGHT, silent=ValueError
        )

    @property
    def parts(self) -> tuple[str, ...]:
        """The parts that can be painted."""
        return paint_parts(self._editor.model)

    @property
    def part(self) -> str:
        """The part to paint: the chosen one, else the largest when the object was first seen; "" if it has none."""
        if self._part in self.parts:
            return self._part
        original = self._editor.original
        visible = self._reshaping.parts
        if visible and (self._largest is None or self._largest[0] != original):
            self._largest = original, visible.map.largest(self.parts)
        largest = self._largest[1] if self._largest else ""
        return largest if largest in self.parts else next(iter(self.parts), "")

    @part.setter
    def part(self, part: str) -> None:
        if part != self.part:
            self._part = part

    @property
    def colour(self) -> Rgb | None:
        """The part's colour, sRGB 0..1: the chosen one, else None until it is measured.

        It is measured once there is a frame. None for an object without a surface; in another shape, the colour of
        before.
        """
        instance = self._editor.scene.instance
        part = self.part
        choices = (*self._due, self._drag) if self._drag else self._due
        colours = [choice.paint.colour for choice in choices if choice.paint.part == part and choice.suits(instance)]
        if colours:
            return colours[-1]

        def stream() -> Iterator[Rgb | None]:
            yield (yield from self._jobs.backend.paint_colour(instance, part))

        request = self._viewport.frame_request
        asks = self._viewport.full_frame is not None and request is not None and request.instance == instance
        colour = self._measured.of((instance, part), stream, asks)
        measured, of_part = self._measured.inputs or (instance, "")
        is_same = of_part == part and measured.codes.texture_key == instance.codes.texture_key
        return self._measured.value if is_same else colour

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
        """Show the part in a colour, sRGB 0..1, coarsely; :meth:`release` gives it to the object."""
        self._drag = _Choice(self._editor.scene.instance, Paint(colour, self.part))
        self.tick()

    def release(self) -> None:
        """End a drag over colours: the object takes the last one, a step of undo."""
        if self._drag and self._due[-1:] != (self._drag,):
            waiting = (choice for choice in self._due[1:] if choice.paint.part != self._drag.paint.part)
            self._set_due((*self._due[:1], *waiting, self._drag))
        self._drag = None

    @property
    def dragged(self) -> Rgb | None:
        """The colour under the mouse during a drag over colours."""
        return self._drag and self._drag.paint.colour

    def cancel(self) -> None:
        """End a drag over colours without a paint."""
        self._drag = None
        self._viewport.repainted = None

    def tick(self) -> None:
        """Show the frame on screen in the colour under the mouse; call once a frame."""
        choice = self._drag
        view = self._viewport
        if choice is None or not view.full_frame or not view.frame_request or view.source != "scene":
            return
        if view.frame_request.instance is not choice.instance:
            return
        frame, crop = view.full_frame
        part = choice.paint.part

        def stream() -> Iterator[CoarsePaint]:
            yield self._jobs.backend.coarse_paint(choice.instance, crop.camera, frame, part)

        if coarse := self._coarse.of((frame, part), stream):
            view.repainted = replace(frame, image=coarse.repainted(choice.paint.colour))

    def _set_due(self, choices: tuple[_Choice, ...]) -> None:
        """Set the paints that the object is about to take, in order."""
        previous = next(iter(self._due), None)
        first = next(iter(choices), None)
        self._due = choices
        if first is not previous:
            self._jobs.cancel("paint")
            if first:
                self._begin(first)

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
            editor.edit(editor.scene.instance.with_texture(painted))
            self._measured.set((editor.scene.instance, choice.paint.part), choice.paint.colour)

        def ended(error: Exception | None) -> None:
            self._jobs.reporting("Cannot paint")(error)
            self._set_due(self._due[1:])
            if editor.scene.instance is choice.instance:
                self._viewport.repainted = None

        self._jobs.submit(Job("paint", stream, keep, ended, urgent=True))
