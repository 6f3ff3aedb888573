"""Needed by everything that takes longer than a frame: the worker, the backend, open models, and messages."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from core.models.open_models import OpenModels
from core.rendering.progressive import Frame, RenderJob
from viewer.services.backend import Backend
from viewer.services.messages import Messages
from viewer.services.worker import Job, Worker

FIT_SHARE, TILES_SHARE, SHARPENING_SHARE, BACKGROUND_SHARE = 0.3, 0.1, 0.03, 0.01
"""of the worker's time against that of a file under way, for a fit, tiles, the view's last pixels and what nobody looks
at; alone each has all of it"""


@dataclass(eq=False)
class Jobs:
    """Given to every activity in place of the session."""

    worker: Worker
    backend: Backend
    messages: Messages
    models: OpenModels

    def frames(self, job: RenderJob) -> Iterator[Frame | None]:
        """Render an object with its model, coarse to fine."""
        return self.backend.frames(self.models.of(job.codes), job)

    def submit(self, job: Job) -> None:
        """Start a job, in place of an older one of its name."""
        self.worker.submit(job)

    def cancel(self, *names: str) -> None:
        """Stop the jobs of these names."""
        for name in names:
            self.worker.cancel(name)

    def busy(self, *names: str) -> bool:
        """Whether a job (one of these names) is under way or has something to deliver."""
        return self.worker.busy(*names)

    def reporting(self, what: str) -> Callable[[Exception | None], None]:
        """For the end of a job: reports what went wrong, if anything did."""
        return lambda error: self.messages.report(what, error) if error else None
