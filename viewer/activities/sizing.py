"""The bounds of the object in the view, from which its size in centimetres follows."""

from collections.abc import Iterator

from core.editing.bounds import Bounds
from core.models.model import Instance
from core.models.motion import prepare_motion
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.latest import Latest


class Sizing:
    """Measures the natural object when its bounds are asked for, but not during a drag."""

    def __init__(self, jobs: Jobs, editor: Editor) -> None:
        self._measure = jobs.backend.bounds
        self._editor = editor
        problem = "Cannot measure the object"  # but for one without a surface, which has no size
        self._bounds = Latest[Instance, Bounds](jobs, "size", problem, urgent=True, silent=ValueError)

    @property
    def bounds(self) -> Bounds | None:
        """The object's natural bounds; None until they are measured, and for an object without a surface."""
        instance = self._editor.scene.instance
        natural = instance.natural.with_texture(instance.model.mean)  # which does not matter

        def stream() -> Iterator[Bounds]:
            yield self._measure(natural)
            prepare_motion(natural)  # sliders are beside the size

        return self._bounds.of(natural, stream, asks=not self._editor.history.gesture)
