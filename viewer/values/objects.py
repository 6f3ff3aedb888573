"""The objects of a session: the training objects of open models, and added objects."""

import re
from collections.abc import Container, Iterable
from dataclasses import dataclass, replace

import torch

from core.models.codes import Codes
from core.models.model import Model
from viewer.values.printable import printable
from viewer.values.variety import families


@dataclass(frozen=True, eq=False)
class EditableObject:
    """An object that can be shown and mixed."""

    name: str
    codes: Codes
    fitted: bool = False  # to a photo
    confidence: float | None = None  # probability, 0..1, that the photo's camera is right; None: unknown

    def __post_init__(self) -> None:
        if self.confidence is not None and not 0 <= self.confidence <= 1:
            raise ValueError(f"a confidence is 0 to 1, got {self.confidence}")


class ObjectLibrary:
    """Objects by name: the models' training objects that did not collapse, and added objects."""

    def __init__(self, models: Iterable[Model]) -> None:
        self._trained: dict[str, EditableObject] = {}
        self._added: dict[str, EditableObject] = {}
        self.removed: frozenset[str] = frozenset()  # names of unlisted added objects, which undo may show again
        self.version = 0  # number of changes so far
        self._names: dict[str, dict[str, str]] = {}  # by model's fingerprint: names here by names in the model
        self.families: dict[str, dict[str, tuple[str, ...]]] = {}
        """By model's fingerprint: one object of each form with its variants, the most different forms first."""
        for model in models:
            self.add_model(model)

    def add_model(self, model: Model) -> None:
        """Add the objects that a model was trained on, or its mean object if there are none."""
        book, names = model.codes, dict[str, str]()
        objects = [(book.objects[index].name, book[index]) for index in book.valid] or [("mean", book.mean)]
        for wanted, codes in objects:
            names[unique_name(wanted, names)] = name = unique_name(wanted, self)
            self._trained[name] = EditableObject(name, codes)
        groups = families(list(names), torch.stack([codes.shape for _, codes in objects]))
        self.families[model.fingerprint] = {
            names[head]: tuple(names[one] for one in variants) for head, variants in groups.items()
        }
        self._names[model.fingerprint] = names
        self.version += 1

    def __getitem__(self, name: str) -> EditableObject:
        return self._added[name] if name in self._added else self._trained[name]

    def __contains__(self, name: object) -> bool:
        return name in self._added or name in self._trained

    @property
    def own(self) -> list[str]:
        """Names of added objects that were not removed, the newest first."""
        return [one.name for one in reversed(self.added)]

    def name_here(self, name: str, model: str) -> str | None:
        """Return the name here of a model's object with this name in another session; None if there is none.

        The names differ if objects of two models share a name, as one of them gets a number.

        Args:
            model: the model's fingerprint.
        """
        if name in self and self[name].codes.model == model:
            return name
        return self._names.get(model, {}).get(re.sub(r" \(\d+\)$", "", name))

    def families_of(self, name: str) -> dict[str, tuple[str, ...]]:
        """Return the families (:attr:`families`) of an object's model; none for an added object."""
        return {} if name in self._added else self.families[self[name].codes.model]

    @property
    def added(self) -> tuple[EditableObject, ...]:
        """Added objects (fitted or opened) that were not removed, the oldest first."""
        return tuple(one for name, one in self._added.items() if name not in self.removed)

    @property
    def ever_added(self) -> tuple[EditableObject, ...]:
        """All added objects, including removed ones."""
        return tuple(self._added.values())

    def add(self, added: EditableObject) -> str:
        """Add an object under a unique name and return that name."""
        name = unique_name(added.name, self)
        self._added[name] = replace(added, name=name)
        self.version += 1
        return name

    def replace(self, name: str, better: EditableObject) -> None:
        """Replace an added object, keeping its name."""
        self._added[name] = replace(better, name=name)
        self.version += 1

    def rename(self, name: str, to: str) -> str:
        """Rename an added object and return its new name, made unique."""
        to = unique_name(to, self)
        self._added = {
            to if key == name else key: replace(one, name=to) if key == name else one
            for key, one in self._added.items()
        }
        self.version += 1
        return to

    def remove(self, *names: str) -> None:
        """Remove added objects from all lists; lookup by name still finds them."""
        self.removed |= frozenset(names)
        self.version += 1

    def add_missing(self, others: Iterable[EditableObject]) -> dict[str, str]:
        """Add the objects whose codes are not here yet; return the names here by the given names.

        Each earlier object matches at most one of ``others``.
        """
        before, names = list(self.ever_added), dict[str, str]()
        for other in others:
            same = [one for one in before if one.codes == other.codes]
            found = min(same, key=lambda one: one.name != other.name, default=None)
            if found:
                before.remove(found)
            names[other.name] = found.name if found else self.add(other)
        return names


def unique_name(wanted: str, taken: Container[str]) -> str:
    """Return the wanted name, printable, with a number if it is taken."""
    name, count = (wanted := printable(wanted)), 1
    while name in taken:
        count += 1
        name = f"{wanted} ({count})"
    return name
