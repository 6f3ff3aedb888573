"""The open models: each object's model is found by the fingerprint in its codes."""

from collections.abc import Callable, Iterator

from core.models.codes import Codes
from core.models.library import former_model
from core.models.model import Model


class OpenModels:
    """Models by name, in the order of opening. Models join and never leave, so codes that found theirs always will."""

    def __init__(self, load: Callable[[str], Model]) -> None:
        """``load`` reads the model of a shipped name or a path, like :func:`core.models.library.load_model`."""
        self.load = load
        self._names: dict[str, str] = {}
        self._models: dict[str, Model] = {}  # by fingerprint

    def __iter__(self) -> Iterator[Model]:
        return iter(tuple(self._models.values()))

    @property
    def names(self) -> tuple[str, ...]:
        """Shipped names and paths, in the order of opening."""
        return tuple(self._names)

    def open(self, name: str) -> Model:
        """Load a model unless it is open. Raises ``ValueError`` if loading fails."""
        if name not in self._names:
            self.add(name, self.load(name))
        return self._models[self._names[name]]

    def add(self, name: str, model: Model) -> None:
        """Add a loaded model; a known fingerprint only gives the known model another name."""
        self._models.setdefault(model.fingerprint, model)
        self._names[name] = model.fingerprint

    def is_former(self, model: Model) -> bool:
        """True for a model that was shipped before, opened because codes of it were met."""
        return model.fingerprint in self._names  # its name in the library

    def of(self, codes: Codes) -> Model:
        """Return the model of an object. Raises ``ValueError`` if it is not open."""
        return self[codes.model]

    def __getitem__(self, fingerprint: str) -> Model:
        """Return the model of a fingerprint, or an open one that extends it; a formerly shipped model is opened.

        Raises ``ValueError`` if there is none.
        """
        if found := self._models.get(fingerprint):
            return found
        if extending := next((one for one in self if one.shares_codes_with(fingerprint)), None):
            return extending
        if former := former_model(fingerprint):
            return self.open(former)
        raise ValueError("it belongs to a model that is not open: drop the model's file on the window first")

    def of_category(self, category: str) -> Model | None:
        """Return the first open model of a category ("cars"), if any."""
        return next((one for one in self if one.category == category), None)


def model_of(models: Model | OpenModels, codes: Codes) -> Model:
    """Return the model of an object from a single model or the open ones."""
    return models if isinstance(models, Model) else models.of(codes)
