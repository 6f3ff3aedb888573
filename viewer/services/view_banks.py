"""View banks of the open models, built in the background and awaited by fits."""

from collections.abc import Callable, Generator

from core.models.model import Model
from core.photos.view_bank import ViewBank


class ViewBanks:
    """One view bank per model. Several jobs that wait for the same bank take turns in building it."""

    def __init__(self, build: Callable[[Model], Generator[float, None, ViewBank]]) -> None:
        """``build`` yields the finished share (0..1), as :func:`core.photos.view_bank.build_view_bank`."""
        self._build = build
        self._built: dict[str, ViewBank] = {}  # by the model's fingerprint
        self._under_way: dict[str, Generator[float, None, ViewBank]] = {}
        self.shares: dict[str, float] = {}  # 0..1, the finished part of each bank that was begun

    def is_built(self, model: Model) -> bool:
        """No job needs to wait for the bank."""
        return model.fingerprint in self._built

    def wait(self, model: Model) -> Generator[None, None, ViewBank]:
        """Return the bank of a model, after as many steps as it takes to build the rest of it."""
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
