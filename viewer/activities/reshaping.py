"""The parts of the object in the view, and drags that move it along directions."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from core.editing.parts import Handle, PartMap
from core.editing.pull import Pull, find_pull
from core.models.model import Instance
from core.models.motion import prepare_motion
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import TILES_WEIGHT, Jobs
from viewer.services.worker import Job
from viewer.values.direction import Direction
from viewer.values.orbit import PanelCrop
from viewer.values.part_highlight import part_highlight
from viewer.values.view_request import ViewRequest

_LEAST = 0.008  # of the view's shorter side, after which a drag's direction is known

Place = tuple[float, float]  # right and down, fractions of the view's width and height


@dataclass(frozen=True, eq=False)
class VisibleParts:
    """The parts of the object on screen."""

    map: PartMap
    crop: PanelCrop  # camera of the map, and its shown part
    highlights: dict[str, UInt8[np.ndarray, "height width 4"]]  # RGBA pixels of the whole image, by part

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom of the shown part of the image, fractions of its width and height."""
        return shown_box(self.crop)

    def handle_at(self, place: Place) -> Handle | None:
        """Return the handle of the part at a place of the view; None beside the object."""
        left, top, right, bottom = self.box
        return self.map.handle_at((left + place[0] * (right - left), top + place[1] * (bottom - top)))

    def place_of(self, handle: Handle) -> Place:
        """Return the place of a handle in the view."""
        left, top, right, bottom = self.box
        return (handle.place[0] - left) / (right - left), (handle.place[1] - top) / (bottom - top)


def shown_box(crop: PanelCrop) -> tuple[float, float, float, float]:
    """Return left, top, right and bottom of a crop, as fractions of the image's width and height."""
    width = crop.camera.width
    height = crop.camera.height
    return crop.left / width, crop.top / height, (crop.left + crop.width) / width, (crop.top + crop.height) / height


class Drag(NamedTuple):
    """A drag of the shape along a direction, by a handle or a slider."""

    gesture: str
    direction: Direction
    start: float  # position along the direction when the drag began
    base: Instance  # the object when the drag began: all its edits start from this one, so errors do not add up
    edited: Instance  # the object as edited last
    pull: Pull | None = None  # of a handle's drag
    to: float = math.nan  # newest position

    @property
    def is_past_end(self) -> bool:
        """True while the drag goes farther than the object can follow."""
        low, high = self.direction.reach(self.base)
        return self.to < low or self.to > high


class Reshaping:
    """Finds the parts in a finished image, once, and moves the object in drags. A drag is one step of undo."""

    def __init__(self, jobs: Jobs, editor: Editor, viewport: Viewport) -> None:
        self._jobs = jobs
        self._editor = editor
        self._viewport = viewport
        self._searched: ViewRequest | None = None  # image whose parts are known or being found
        self._parts: VisibleParts | None = None
        self._drag: Drag | None = None

    # Parts

    @property
    def parts(self) -> VisibleParts | None:
        """The parts in the image on screen, which are looked for once asked for; None until they are found.

        There are none while the image is unfinished, something is dragged, or a fit is followed.
        """
        view = self._viewport
        request = view.frame_request
        is_due = view.source == "scene" and not (view.following or view.baked_frame or self._editor.history.gesture)
        if not is_due or view.full_frame is None or not view.full_frame[0].final or request != view.request:
            return None
        if request is not self._searched and request != self._searched:
            self._find_parts(request)
        return self._parts

    def _find_parts(self, request: ViewRequest) -> None:
        assert self._viewport.full_frame is not None
        frame, crop = self._viewport.full_frame
        self._searched = request
        self._parts = None
        find = self._jobs.backend.part_map

        def stream() -> Iterator[VisibleParts | None]:
            regions = find(request.instance, crop.camera, frame, shown_box(crop))
            yield None
            prepare_motion(request.instance)
            yield None
            highlights = {}
            for part in {handle.part for handle in regions.handles}:
                highlights[part] = part_highlight(regions.mask(part), frame.opacity)
                yield None
            yield VisibleParts(regions, crop, highlights)

        def keep(visible: VisibleParts) -> None:
            self._parts = visible

        ended = self._jobs.reporting("Cannot find the object's parts")
        self._jobs.submit(Job("parts", stream, keep, ended, weight=TILES_WEIGHT))

    # Drags

    def drag_handle(self, handle: Handle, drag: Place, words: Sequence[str]) -> None:
        """Reshape the object as a handle is dragged, from where it was pressed; then call :meth:`release`.

        Nothing happens once anything else changes the shape, such as undo.

        Args:
            drag: right and down, fractions of the view's shorter side.
            words: of the shape directions.
        """
        full = self._viewport.request.full
        pixels = drag[0] * full, drag[1] * full
        now = self._drag
        if now is None and math.hypot(*drag) >= _LEAST:
            now = self._pull(handle, pixels, words)
        # Undo or a fit's result may show another shape while the handle is still held: that ends the drag.
        if now and now.pull and self._editor.scene.instance.codes.shape_key == now.edited.codes.shape_key:
            self._move(now, now.start + now.pull.amount(pixels))

    def _pull(self, handle: Handle, pixels: Place, words: Sequence[str]) -> Drag:
        """Return a handle's drag along the direction that follows its first pixels."""
        request = self._viewport.request
        instance = self._editor.scene.instance
        pull = find_pull(instance, words, request.crop(request.full).camera, handle.point, pixels)
        word = words[pull.direction] if pull.direction < len(words) else ""
        direction = Direction.principal(instance.model.codes, "shape", pull.direction, word)
        return Drag("reshape", direction, direction.strength(instance), instance, instance, pull)

    @property
    def drag(self) -> Drag | None:
        """The drag of a handle, until it is released; None before its direction is known."""
        return self._drag if self._drag and self._drag.pull else None

    def move_along(self, direction: Direction, to: float, gesture: str) -> None:
        """Move the object along a direction as part of a drag; then call :meth:`release`."""
        now = self._drag
        if now is None or now.gesture != gesture:
            instance = self._editor.scene.instance
            now = Drag(gesture, direction, direction.strength(instance), instance, instance)
        self._move(now, to)

    def _move(self, drag: Drag, to: float) -> None:
        """Move the object to a position; the drag starts anew from another object."""
        instance = self._editor.scene.instance
        if drag.edited is not instance:
            drag = drag._replace(base=instance)
        if drag.edited is not instance or to != drag.to:
            self._editor.edit(drag.direction.moved(drag.base, to), drag.gesture)
        self._drag = drag._replace(edited=self._editor.scene.instance, to=to)

    def release(self) -> None:
        """End the drag; the next one is another step of undo."""
        self._drag = None
        self._editor.end_gesture()
