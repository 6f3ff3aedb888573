"""The open models. The fingerprint in an object's codes identifies its model."""

from collections.abc import Callable, Iterator

from core.models.codes import Codes
from core.models.library import former_model
from core.models.model import Model


class OpenModels:
    """Models by name, in the order of opening. No model is ever closed, so the models of codes in use stay available.

    Args:
        load: reads the model of a shipped name or a path, such as :func:`core.models.library.load_model`.
    """

    def __init__(self, load: Callable[[str], Model]) -> None:
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
        """Return the model of a name, loading it unless it is open. Raises ``ValueError`` if loading fails."""
        if name not in self._names:
            self.add(name, self.load(name))
        return self._models[self._names[name]]

    def add(self, name: str, model: Model) -> None:
        """Add a loaded model. If a model with its fingerprint is open, that model only gets another name."""
        self._models.setdefault(model.fingerprint, model)
        self._names[name] = model.fingerprint

    def is_former(self, model: Model) -> bool:
        """True for a formerly shipped model, which opens when codes refer to it."""
        return model.fingerprint in self._names  # its name in the library

    def of(self, codes: Codes) -> Model:
        """Return the model of an object. Raises ``ValueError`` if it is not open."""
        return self[codes.model]

    def __getitem__(self, fingerprint: str) -> Model:
        """Return the open model with a fingerprint, else an open model that extends it.

        Otherwise opens the formerly shipped model. Raises ``ValueError`` if there is none.
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
    """Return the model of an object: the given one, or that among the open models."""
    return models if isinstance(models, Model) else models.of(codes)
