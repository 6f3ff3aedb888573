"""Shared by everything that takes longer than a frame: worker, backend, open models, view banks, messages."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

from core.models.open_models import OpenModels
from core.rendering.progressive import Frame, RenderJob
from viewer.services.backend import Backend
from viewer.services.messages import Messages
from viewer.services.view_banks import ViewBanks
from viewer.services.worker import Job, Worker

FIT_SHARE, TILES_SHARE, SHARPENING_SHARE, BACKGROUND_SHARE = 0.3, 0.1, 0.03, 0.01
"""Shares of the worker's time beside an export (1.0): a fit, tiles, the view's last pixels, and invisible work."""


@dataclass(eq=False)
class Jobs:
    """Passed to every activity instead of the session."""

    worker: Worker
    backend: Backend
    messages: Messages
    models: OpenModels

    @cached_property
    def banks(self) -> ViewBanks:
        """View banks of the open models."""
        return ViewBanks(self.backend.view_bank)

    def frames(self, job: RenderJob) -> Iterator[Frame | None]:
        """Render an object with its model, coarse to fine."""
        return self.backend.frames(self.models.of(job.codes), job)

    def submit(self, job: Job) -> None:
        """Start a job, replacing an older one of its name."""
        self.worker.submit(job)

    def cancel(self, *names: str) -> None:
        """Stop the jobs of these names."""
        for name in names:
            self.worker.cancel(name)

    def busy(self, *names: str) -> bool:
        """True if a job (one of these names) is running or has results to deliver."""
        return self.worker.busy(*names)

    def reporting(self, what: str) -> Callable[[Exception | None], None]:
        """Return an end callback that reports an error, if any."""
        return lambda error: self.messages.report(what, error) if error else None
