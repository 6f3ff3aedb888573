"""The words of principal directions, such as *wider*, measured in the background once per model."""

from core.editing.words import Words
from core.models.model import Model
from viewer.services.jobs import BACKGROUND_WEIGHT, Jobs
from viewer.services.worker import Job


class DirectionWords:
    """Measures a model's words when they are first asked for."""

    def __init__(self, jobs: Jobs) -> None:
        self._jobs = jobs
        self._words: dict[str, Words | None] = {}  # by the model's fingerprint; None while they are measured

    def of_model(self, model: Model) -> Words | None:
        """Return the words of both codes' directions; None until they are measured."""
        if model.fingerprint not in self._words:
            self._measure(model)
        return self._words[model.fingerprint]

    def _measure(self, model: Model) -> None:
        self._words[model.fingerprint] = None
        measure = self._jobs.backend.direction_words

        def keep(words: Words) -> None:
            self._words[model.fingerprint] = words

        self._jobs.submit(Job(f"words {model.fingerprint}", lambda: measure(model), keep, weight=BACKGROUND_WEIGHT))
