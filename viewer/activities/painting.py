"""The paint of the object in the view: colours of its parts, measured and changed on the worker."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import torch

from core.detail.paint import CoarsePaint, Paint, Rgb, paint_parts
from core.detail.progressive import Frame
from core.geometry.camera import Camera
from core.models.model import Instance
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import BACKGROUND_WEIGHT, Jobs
from viewer.services.messages import MessageKind
from viewer.services.worker import Job


class _Choice(NamedTuple):
    """A paint for an object."""

    instance: Instance
    paint: Paint

    def suits(self, instance: Instance) -> bool:
        """Return whether the paint suits another object: one of the same texture code, in any shape and paint."""
        return torch.equal(self.instance.codes.texture, instance.codes.texture)


class Painting:
    """Paints a part: during a drag over colours the frame on screen, coarsely, and then the object, in one step."""

    def __init__(self, jobs: Jobs, editor: Editor, viewport: Viewport) -> None:
        self._jobs = jobs
        self._editor = editor
        self._viewport = viewport
        self._part = ""  # chosen part
        self._choice: _Choice | None = None  # the latest; the object does not have it yet
        self._due: tuple[_Choice, ...] = ()  # of different parts, released; the object is being painted with the first
        self._coarse: tuple[Frame, str, CoarsePaint | None] | None = None  # frame, part, and paint once it is found
        self._shown: tuple[CoarsePaint, Rgb] | None = None  # on screen
        self._measured: tuple[Instance, str, Rgb | None] | None = None  # object, part, and the part's colour if known
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
        """The part's colour, sRGB 0..1: the chosen one, else that of the frame on screen until it is measured.

        None until there is a frame, and for an object without a surface; in another shape, the colour of before.
        """
        instance = self._editor.scene.instance
        part = self.part
        choice = self._choice
        if choice and part == choice.paint.part and choice.suits(instance):
            return choice.paint.colour
        before, of_part, colour = self._measured or (None, "", None)
        if before != instance or of_part != part:
            is_same = before and of_part == part and before.codes.texture_key == instance.codes.texture_key
            colour = colour if is_same else None
            view = self._viewport
            if view.full_frame and view.frame_request and view.frame_request.instance == instance:
                self._measured = instance, part, colour
                self._measure(instance, part, view.full_frame[0], view.full_frame[1].camera)
        return colour

    def _measure(self, instance: Instance, part: str, frame: Frame, camera: Camera) -> None:
        """Begin to measure a part's colour: coarsely in a frame at once, then in the background."""
        backend = self._jobs.backend

        def stream() -> Iterator[Rgb | None]:
            yield backend.coarse_paint(instance, camera, frame, part).colour
            yield (yield from backend.paint_colour(instance, part))

        def keep(colour: Rgb) -> None:
            self._measured = instance, part, colour

        def ended(error: Exception | None) -> None:
            if not isinstance(error, ValueError):  # an object without a surface has no colour
                self._jobs.reporting("Cannot find the paint")(error)

        self._jobs.submit(Job("paint colour", stream, keep, ended, urgent=True, weight=BACKGROUND_WEIGHT))

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
        self._choice = self._viewport.repainted = None
        self._editor.edit(self._original)

    def paint(self, colour: Rgb) -> None:
        """Show the part in a colour, sRGB 0..1, coarsely; :meth:`release` gives it to the object."""
        self._choice = choice = _Choice(self._editor.scene.instance, Paint(colour, self.part))
        self._set_due(tuple(due for due in self._due if due.paint.part != choice.paint.part))
        self._released = False
        self._shown = None
        self.tick()

    def _is_reachable(self, instance: Instance) -> bool:
        """Return whether an object is on screen or can be reached by undo."""
        states = (self._editor.state, *self._editor.history.past)
        return any(state.scene.instance is instance for state in states)

    def release(self) -> None:
        """End a drag over colours: the object takes the last one, a step of undo."""
        if not self._released and self._choice:
            self._released = True
            self._set_due((*self._due, self._choice))

    def _set_due(self, due: tuple[_Choice, ...]) -> None:
        """Set the paints that the object is about to take, in order."""
        before = self._due[:1]
        self._due = due
        if due[:1] != before:
            self._jobs.cancel("paint")
            if due:
                self._begin(due[0])

    def _begin(self, choice: _Choice) -> None:
        """Begin to paint an object; one that was reshaped meanwhile takes the paint, too."""

        def stream() -> Iterator[Instance | None]:
            yield (yield from self._jobs.backend.paint(choice.instance, choice.paint))

        def keep(painted: Instance) -> None:
            now = self._editor.scene.instance
            if not self._is_reachable(choice.instance):
                return  # undone meanwhile
            if not choice.suits(now):
                self._jobs.messages.notify("The paint was left out, as you had gone on: paint again", MessageKind.NOTE)
            elif now.codes.paints != choice.instance.codes.paints:  # of another part
                again = choice._replace(instance=now)
                self._choice = again if self._choice is choice else self._choice
                self._set_due((again, *self._due[1:]))
            else:
                self._editor.edit(now.with_texture(painted))
                self._jobs.cancel("paint colour")  # of the object before
                self._measured = self._editor.scene.instance, choice.paint.part, choice.paint.colour

        def ended(error: Exception | None) -> None:
            self._jobs.reporting("Cannot paint")(error)
            if self._choice is choice:
                self._choice = None
                if self._editor.scene.instance is choice.instance:
                    self._viewport.repainted = None
            self._set_due(tuple(due for due in self._due if due is not choice))

        self._jobs.submit(Job("paint", stream, keep, ended, urgent=True))

    def close(self) -> None:
        """Stop painting."""
        self._set_due(())
        self._choice = self._coarse = None
        self._jobs.cancel("paint colour", "coarse paint")

    def tick(self) -> None:
        """Show the frame on screen in the chosen paint until the object has it; call once a frame."""
        choice = self._choice
        view = self._viewport
        if choice is None or not view.full_frame or not view.frame_request or view.source != "scene":
            return
        instance = self._editor.scene.instance
        if not choice.suits(instance) or view.frame_request.instance is not instance:
            return
        frame, crop = view.full_frame
        part = choice.paint.part
        if self._coarse is None or self._coarse[:2] != (frame, part):
            self._find_coarse(frame, crop.camera, choice._replace(instance=instance))
        elif self._coarse[2] and self._shown != (self._coarse[2], choice.paint.colour):
            self._shown = self._coarse[2], choice.paint.colour
            view.repainted = replace(frame, image=self._coarse[2].repainted(choice.paint.colour))

    def _find_coarse(self, frame: Frame, camera: Camera, choice: _Choice) -> None:
        """Begin to find where a frame of an object, seen from ``camera``, takes a paint."""
        self._coarse = frame, choice.paint.part, None
        find = self._jobs.backend.coarse_paint

        def found(coarse: CoarsePaint) -> None:
            self._coarse = frame, choice.paint.part, coarse

        def stream() -> Iterator[CoarsePaint]:
            yield find(choice.instance, camera, frame, choice.paint.part)

        self._jobs.submit(
            Job("coarse paint", stream, found, self._jobs.reporting("Cannot show the paint"), urgent=True)
        )
