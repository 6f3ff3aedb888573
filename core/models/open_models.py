"""The open models, by fingerprint; objects that were read find theirs among them."""

from collections.abc import Callable, Iterator
from pathlib import Path

from core.models.missing import adopted
from core.models.model import Instance, Model


class OpenModels:
    """Models by name, in the order of opening. No model is ever closed, so objects in use stay available.

    Args:
        load: reads the model of a shipped name or a path, such as :func:`core.models.library.load_model`.
    """

    def __init__(self, load: Callable[[str], Model]) -> None:
        self.load = load
        self._names: dict[str, str] = {}
        self._models: dict[str, Model] = {}  # by fingerprint
        self._expected: dict[str, str] = {}  # names of models that objects were made with, by fingerprint
        self._missing = set[str]()  # fingerprints that were searched in vain since the last model was opened

    def __iter__(self) -> Iterator[Model]:
        return iter(tuple(self._models.values()))

    @property
    def files(self) -> dict[str, str]:
        """Shipped names and paths by fingerprint, also of models that are missing."""
        return self._expected | {fingerprint: name for name, fingerprint in self._names.items()}

    def open(self, name: str) -> Model:
        """Return the model of a name, loading it unless it is open. Raises ``ValueError`` if loading fails."""
        if name not in self._names:
            self.add(name, self.load(name))
        return self._models[self._names[name]]

    def add(self, name: str, model: Model) -> None:
        """Add a loaded model. If a model with its fingerprint is open, that model only gets another name."""
        self._models.setdefault(model.fingerprint, model)
        self._names[name] = model.fingerprint
        self._missing.clear()

    def expect(self, fingerprint: str, name: str) -> None:
        """Note the name or path of the model with a fingerprint, which is opened when an object refers to it."""
        if name and self._expected.get(fingerprint) != name:
            self._expected[fingerprint] = name
            self._missing.discard(fingerprint)

    def adopt(self, instance: Instance) -> Instance:
        """Return an object as one of its model, or of an open one that extends it; as it is while there is none."""
        if not instance.is_missing:
            return instance
        model = self.find(instance.fingerprint)
        return adopted(model, instance) if model and model.fits(instance.codes) else instance

    def find(self, fingerprint: str) -> Model | None:
        """Return the open model with a fingerprint, else an open model that extends it.

        Otherwise opens the expected file. None if there is none.
        """
        if model := self._models.get(fingerprint):
            return model
        if fingerprint in self._missing:
            return None
        if extending := next((model for model in self if model.shares_codes_with(fingerprint)), None):
            return extending
        if expected := self._load_expected(fingerprint):
            return expected
        self._missing.add(fingerprint)
        return None

    def _load_expected(self, fingerprint: str) -> Model | None:
        """Open the expected file of a model; None if it is missing, damaged or another model by now."""
        name = self._expected.get(fingerprint, "")
        if name in self._names or not Path(name).is_file():
            return None
        try:
            model = self.load(name)
        except ValueError:
            return None
        if not model.shares_codes_with(fingerprint):
            return None
        self.add(name, model)
        return self._models[model.fingerprint]

    def __getitem__(self, fingerprint: str) -> Model:
        """Return a model as :meth:`find` does. Raises ``ValueError`` if it is missing."""
        if model := self.find(fingerprint):
            return model
        name = Path(self._expected.get(fingerprint, "")).name
        missing = f"the model {name}, which is not there" if name else "a model that is not open"
        raise ValueError(f"it belongs to {missing}: drop the model's file on the window first")

    def of_category(self, category: str) -> Model | None:
        """Return the first open model of a category ("cars"), if any."""
        return next((model for model in self if model.category == category), None)
