"""The parts and the size of the object in the view, and drags that change it."""

import math
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from core.editing.bounds import Bounds
from core.editing.parts import Handle, PartMap
from core.editing.pull import Pull, find_pull
from core.editing.size import lengths, resized
from core.edits.edit import UNIT
from core.models.model import Instance
from core.models.motion import prepare_motion
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import TILES_WEIGHT, Jobs
from viewer.services.latest import Latest
from viewer.values.orbit import PanelCrop
from viewer.values.part_highlight import part_highlight
from viewer.values.view_request import ViewRequest

_LEAST = 0.008  # of the view's shorter side, after which a drag's direction is known
_EQUAL = 1e-3  # relative difference of lengths below which the object has followed a drag

Place = tuple[float, float]  # right and down, fractions of the view's width and height


@dataclass(frozen=True, eq=False)
class VisibleParts:
    """The parts of the object on screen."""

    map: PartMap
    crop: PanelCrop  # camera of the map, and its shown part
    highlights: dict[str, UInt8[np.ndarray, "height width 4"]]  # RGBA pixels of the whole image, by part

    def handle_at(self, place: Place) -> Handle | None:
        """Return the handle of the part at a place of the view; None beside the object."""
        left, top, right, bottom = self.crop.box
        return self.map.handle_at((left + place[0] * (right - left), top + place[1] * (bottom - top)))

    def place_of(self, handle: Handle) -> Place:
        """Return the place of a handle in the view."""
        left, top, right, bottom = self.crop.box
        return (handle.place[0] - left) / (right - left), (handle.place[1] - top) / (bottom - top)


class Drag(NamedTuple):
    """A drag that changes the object."""

    gesture: str
    base: Instance  # the object when the drag began: all its edits start from this one, so errors do not add up
    edited: Instance  # the object as edited last
    to: float  # newest value


class Reshaping:
    """Finds the parts in a finished image, once, and changes the object in drags. A drag is one step of undo."""

    def __init__(self, jobs: Jobs, editor: Editor, viewport: Viewport) -> None:
        self._jobs = jobs
        self._editor = editor
        self._viewport = viewport
        problem = "Cannot find the object's parts"
        self._parts = Latest[ViewRequest, VisibleParts](jobs, "parts", problem, weight=TILES_WEIGHT)
        problem = "Cannot measure the object"  # but for one without a surface, which has no size
        self._bounds = Latest[Instance, Bounds](jobs, "size", problem, urgent=True, silent=ValueError)
        self._drag: Drag | None = None
        self.pull: Pull | None = None  # of the drag of a part's handle, once its direction is known

    # Parts and size

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
        frame, crop = view.full_frame

        def stream() -> Iterator[VisibleParts | None]:
            regions = self._jobs.backend.part_map(request.instance, crop.camera, frame, crop.box)
            yield None
            highlights = {}
            for part in {handle.part for handle in regions.handles}:
                highlights[part] = part_highlight(regions.mask(part), frame.opacity)
                yield None
            yield VisibleParts(regions, crop, highlights)

        return self._parts.of(request, stream)

    @property
    def bounds(self) -> Bounds | None:
        """The object's natural bounds; None until they are measured, and for an object without a surface."""
        instance = self._editor.scene.instance
        natural = instance.natural.with_texture(instance.model.mean)  # which does not matter

        def stream() -> Iterator[Bounds]:
            yield self._jobs.backend.bounds(natural)
            prepare_motion(natural)  # sliders are beside the size

        return self._bounds.of(natural, stream, asks=not self._editor.history.gesture)

    # Drags

    def follow(self, gesture: str, change: Callable[[Instance, float], Instance], to: float) -> None:
        """Change the object as part of a drag, which begins with the first call; then call :meth:`release`.

        Args:
            change: returns an object with a value.
            to: the value that the drag has reached.
        """
        instance = self._editor.scene.instance
        drag = self._drag
        if drag is None or (drag.gesture, drag.edited) != (gesture, instance):
            drag = Drag(gesture, instance, instance, math.nan)
        if to != drag.to:
            self._editor.edit(change(drag.base, to), gesture)
        self._drag = drag._replace(edited=self._editor.scene.instance, to=to)

    def resize(self, name: str, length: float) -> None:
        """Give the object a length in cm (:func:`core.editing.size.resized`) as part of a drag."""
        natural = self.bounds
        if natural is not None:
            self.follow(f"size {name}", lambda instance, to: resized(instance, natural, name, to), length)

    def drag_handle(self, handle: Handle, drag: Place) -> None:
        """Resize the object as a part's handle is dragged right and down, by fractions of the view's shorter side."""
        request = self._viewport.request
        pixels = drag[0] * request.full, drag[1] * request.full
        natural = self.bounds
        pull = self.pull
        if pull is None and natural and math.hypot(*drag) >= _LEAST:
            instance = self._editor.scene.instance
            factors = instance.codes.proportions or UNIT
            x, y, z = (side * factor for side, factor in zip(handle.point, factors, strict=True))
            pull = find_pull(instance, natural, request.crop(request.full).camera, handle.part, (x, y, z), pixels)
        if pull:
            self.drag_length(pull, pixels)

    def drag_length(self, pull: Pull, pixels: tuple[float, float]) -> None:
        """Change a length by a drag from where it was pressed; then call :meth:`release`.

        Nothing happens once anything else changes the shape, such as undo or a fit's result.

        Args:
            pull: that of the first call counts.
            pixels: right and down, px of the view's image.
        """
        self.pull = self.pull or pull
        if self._drag is None or _shape(self._drag.edited) == _shape(self._editor.scene.instance):
            self.resize(self.pull.name, self.pull.to(pixels))

    @property
    def is_past_end(self) -> bool:
        """True while the drag of a part's handle goes farther than the object can follow."""
        natural = self.bounds
        if self.pull is None or self._drag is None or natural is None:
            return False
        return not math.isclose(lengths(self._drag.edited, natural)[self.pull.name], self._drag.to, rel_tol=_EQUAL)

    def release(self) -> None:
        """End the drag; the next one is another step of undo."""
        self._drag = self.pull = None
        self._editor.end_gesture()


def _shape(instance: Instance) -> tuple[Hashable, ...]:
    """Return all that a drag of the size or the shape changes, as a comparable key."""
    return instance.codes.shape_key, instance.codes.edits_of("size")
