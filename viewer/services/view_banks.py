"""View banks of the open models, built in the background and awaited by fits."""

from collections.abc import Callable, Generator

from core.models.model import Model
from core.photos.view_bank import ViewBank


class ViewBanks:
    """One view bank per model. Jobs that wait for the same bank take turns in building it."""

    def __init__(self, build: Callable[[Model], Generator[float, None, ViewBank]]) -> None:
        """Build with ``build``, which yields the finished fraction, 0..1, and returns the bank."""
        self._build = build
        self._built: dict[str, ViewBank] = {}  # by the model's fingerprint
        self._under_way: dict[str, Generator[float, None, ViewBank]] = {}  # unfinished builds, by fingerprint
        self.shares: dict[str, float] = {}  # finished fraction of each begun bank, 0..1, by fingerprint

    def wait(self, model: Model) -> Generator[None, None, ViewBank]:
        """Build the rest of a model's bank, a step per value, and return the bank."""
        key = model.fingerprint
        while key not in self._built:
            building = self._under_way.pop(key, None) or self._build(model)
            try:
                self.shares[key] = next(building)
            except StopIteration as end:
                self._built[key], self.shares[key] = end.value, 1.0
            else:
                self._under_way[key] = building
                yield
        return self._built[key]
