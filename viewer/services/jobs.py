"""The services of long work: worker, backend, open models, messages."""

from collections.abc import Callable
from dataclasses import dataclass

from core.models.open_models import OpenModels
from viewer.services.backend import Backend
from viewer.services.messages import Messages
from viewer.services.worker import Job, Worker

# Weights of jobs, where an export has 1.0. With a tenth of the weight of another job, a job slows that one by a tenth
# and never starves.
FIT_WEIGHT = 0.1  # fits and previews
TILES_WEIGHT = 0.03  # with 0.01, a tile took 4 s beside a fit and a film
SHARPENING_WEIGHT = 0.003  # the view's last pixels
BACKGROUND_WEIGHT = 0.001  # work that is not seen


@dataclass(eq=False)
class Jobs:
    """The services that every activity gets instead of the session."""

    worker: Worker
    backend: Backend
    messages: Messages
    models: OpenModels

    def submit(self, job: Job) -> None:
        """Start a job as :meth:`Worker.submit` does."""
        self.worker.submit(job)

    def cancel(self, *names: str) -> None:
        """Stop the jobs of these names and drop their pending callbacks."""
        for name in names:
            self.worker.cancel(name)

    def busy(self, *names: str) -> bool:
        """True if a job, of these names if given, is running or has callbacks pending."""
        return self.worker.busy(*names)

    def reporting(self, what: str) -> Callable[[Exception | None], None]:
        """Return a callback for a job's end that reports its error, if any, after the words ``what``."""
        return lambda error: self.messages.report(what, error) if error else None
