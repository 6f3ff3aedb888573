"""The bounds of the object in the view, from which its size in centimetres follows."""

from collections.abc import Iterator

from core.editing.bounds import Bounds
from core.models.model import Instance
from core.models.motion import prepare_motion
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.worker import Job


class Sizing:
    """Measures the natural object when its bounds are asked for, but not during a drag."""

    def __init__(self, jobs: Jobs, editor: Editor) -> None:
        self._jobs = jobs
        self._editor = editor
        self._measured: tuple[Instance, Bounds | None] | None = None  # the last natural object; None: without a surface

    @property
    def bounds(self) -> Bounds | None:
        """The object's natural bounds; None until they are measured, and for an object without a surface."""
        instance = self._editor.scene.instance
        natural = instance.natural.with_texture(instance.model.mean)  # which does not matter
        if self._measured and self._measured[0] == natural:
            return self._measured[1]
        if not self._editor.history.gesture and not self._jobs.busy("size"):
            self._measure(natural)
        return None

    def _measure(self, natural: Instance) -> None:
        measure = self._jobs.backend.bounds
        report = self._jobs.reporting("Cannot measure the object")

        def keep(bounds: Bounds) -> None:
            self._measured = natural, bounds

        def ended(error: Exception | None) -> None:
            if error:
                self._measured = natural, None
            if not isinstance(error, ValueError):  # an object without a surface can be edited, but has no size
                report(error)

        def stream() -> Iterator[Bounds]:
            yield measure(natural)
            prepare_motion(natural)  # sliders are beside the size

        self._jobs.submit(Job("size", stream, keep, ended, urgent=True))
