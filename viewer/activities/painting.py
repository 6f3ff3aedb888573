"""The paint of the object in the view: colours of its parts, measured and changed on the worker."""

from collections.abc import Iterator
from dataclasses import replace

import torch
from torch import Tensor

from core.detail.paint import CoarsePaint, Paint, Rgb, paint_parts
from core.detail.progressive import Frame
from core.geometry.camera import Camera
from core.models.model import Instance
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import BACKGROUND_WEIGHT, Jobs
from viewer.services.messages import MessageKind
from viewer.services.worker import Job
from viewer.values.paints import PaintRequest


class Painting:
    """Paints a part: during a drag over colours the frame on screen, coarsely, and then the object, in one step."""

    def __init__(self, jobs: Jobs, editor: Editor, viewport: Viewport) -> None:
        self._jobs = jobs
        self._editor = editor
        self._viewport = viewport
        self._part = ""  # chosen part
        self._choice: PaintRequest | None = None  # its texture is not found yet
        self._earlier: tuple[PaintRequest, ...] = ()  # of other parts of its object, likewise, painted before it
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
        if choice and part == choice.paint.part and torch.equal(instance.codes.texture, choice.instance.codes.texture):
            return choice.paint.colour
        before, of_part, colour = self._measured or (None, "", None)
        if before != instance or of_part != part:
            is_same = (
                before is not None and of_part == part and torch.equal(before.codes.texture, instance.codes.texture)
            )
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
        return bool((self._editor.code("texture") == self._original).all())

    @property
    def _original(self) -> Tensor:
        instance = self._editor.scene.instance
        return instance.detail.texture if instance.detail else self._editor.original.codes.texture

    @property
    def unfinished(self) -> tuple[PaintRequest, ...]:
        """The paints that the object is about to take, in order."""
        return (*self._earlier, self._choice) if self._choice and self._released else self._earlier

    def take_over(self, unfinished: tuple[PaintRequest, ...]) -> None:
        """Continue with paints of an earlier run, unless their object was undone."""
        states = (self._editor.state, *self._editor.history.past)
        instances = [state.scene.instance for state in states]
        for request in unfinished:
            if request.instance in instances:
                kept = instances[instances.index(request.instance)]
                self._choose(PaintRequest(kept, request.paint))
                self.release()

    def restore(self) -> None:
        """Restore the original paint."""
        self._editor.set_texture(self._original)

    def paint(self, colour: Rgb) -> None:
        """Show the part in a colour, sRGB 0..1, coarsely; :meth:`release` gives it to the object."""
        self._choose(PaintRequest(self._editor.scene.instance, Paint(colour, self.part)))
        self.tick()

    def _choose(self, choice: PaintRequest) -> None:
        """Choose a paint; released paints of other parts are found again before it."""
        self._jobs.cancel("paint")
        instance = choice.instance
        part = choice.paint.part
        self._earlier = tuple(
            request if request.instance is instance else request._replace(instance=instance)
            for request in self.unfinished
            if request.paint.part != part and self._is_paintable(request.instance, instance)
        )
        self._choice = choice
        self._released = False
        self._shown = None

    def _is_paintable(self, chosen: Instance, now: Instance) -> bool:
        """Return whether a paint chosen for an object suits it now: it was not undone, and has the same texture."""
        return self._is_reachable(chosen) and torch.equal(chosen.codes.texture, now.codes.texture)

    def _is_reachable(self, instance: Instance) -> bool:
        """Return whether an object is on screen or can be reached by undo."""
        states = (self._editor.state, *self._editor.history.past)
        return any(state.scene.instance is instance for state in states)

    def release(self) -> None:
        """End a drag over colours: the object takes the last one, a step of undo, after paints of other parts."""
        if self._released or self._choice is None:
            return
        self._released = True
        choice = self._choice
        requests = self.unfinished

        def stream() -> Iterator[list[Instance] | None]:
            painted = [choice.instance]
            for request in requests:
                painted.append((yield from self._jobs.backend.paint(painted[-1], request.paint)))
            yield painted[1:]

        def keep(painted: list[Instance]) -> None:
            if not self._is_reachable(choice.instance):
                return  # undone meanwhile
            if not self._is_paintable(choice.instance, self._editor.scene.instance):
                self._jobs.messages.notify("The paint was left out, as you had gone on: paint again", MessageKind.NOTE)
                return
            for instance in painted:
                self._editor.set_texture(instance.codes.texture)
            self._jobs.cancel("paint colour")  # of the object before
            self._measured = self._editor.scene.instance, choice.paint.part, choice.paint.colour

        def ended(error: Exception | None) -> None:
            self._jobs.reporting("Cannot paint")(error)
            self._choice = None
            self._earlier = ()
            if self._editor.scene.instance is choice.instance:
                self._viewport.repainted = None

        self._jobs.submit(Job("paint", stream, keep, ended, urgent=True))

    def tick(self) -> None:
        """Show the frame on screen in the chosen paint until the object has it; call once a frame."""
        choice = self._choice
        view = self._viewport
        if choice is None or not view.full_frame or not view.frame_request or view.source != "scene":
            return
        if self._editor.scene.instance is not choice.instance or view.frame_request.instance is not choice.instance:
            return
        frame, crop = view.full_frame
        part = choice.paint.part
        if self._coarse is None or self._coarse[:2] != (frame, part):
            self._find_coarse(frame, crop.camera, choice)
        elif self._coarse[2] and self._shown != (self._coarse[2], choice.paint.colour):
            self._shown = self._coarse[2], choice.paint.colour
            view.repainted = replace(frame, image=self._coarse[2].repainted(choice.paint.colour))

    def _find_coarse(self, frame: Frame, camera: Camera, choice: PaintRequest) -> None:
        """Begin to find where a frame of the chosen object, seen from ``camera``, has paint."""
        self._coarse = frame, choice.paint.part, None
        find = self._jobs.backend.coarse_paint

        def found(coarse: CoarsePaint) -> None:
            self._coarse = frame, choice.paint.part, coarse

        def stream() -> Iterator[CoarsePaint]:
            yield find(choice.instance, camera, frame, choice.paint.part)

        self._jobs.submit(
            Job("coarse paint", stream, found, self._jobs.reporting("Cannot show the paint"), urgent=True)
        )
