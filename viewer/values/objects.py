"""The objects of a session: training objects of the open models, and added ones."""

import re
from collections.abc import Container, Iterable
from dataclasses import dataclass, replace
from itertools import chain

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
    confidence: float | None = None  # probability that the photo's camera is right; None: unknown
    photo: str = ""  # digest of that photo's pixels; empty if unknown

    def __post_init__(self) -> None:
        if self.confidence is not None and not 0 <= self.confidence <= 1:
            raise ValueError(f"a confidence is 0 to 1, got {self.confidence}")


class ObjectLibrary:
    """Objects by name: those of the models except collapsed ones, and added ones."""

    def __init__(self, models: Iterable[Model]) -> None:
        self._trained: dict[str, EditableObject] = {}
        self._added: dict[str, EditableObject] = {}
        self.removed: frozenset[str] = frozenset()  # in no list, but undo may restore them
        self.version = 0  # counts the changes
        self._names: dict[str, dict[str, str]] = {}  # by model's fingerprint, names here of its objects by their own
        self.families: dict[str, dict[str, tuple[str, ...]]] = {}
        """by fingerprint of the model: one object of each form and its variants, different forms first"""
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
    def names(self) -> list[str]:
        """Added objects, the newest first, then those of each model: one of each form, then the variants."""
        forms = self.families.values()
        return [*self.own, *(name for one in forms for name in (*one, *chain.from_iterable(one.values())))]

    @property
    def own(self) -> list[str]:
        """Names of added objects, the newest first."""
        return [one.name for one in reversed(self.added)]

    def name_here(self, name: str, model: str) -> str | None:
        """Return the name of an object of a model that had this name elsewhere; None if there is none.

        Names differ where two models have objects of the same name.

        Args:
            model: fingerprint.
        """
        if name in self and self[name].codes.model == model:
            return name
        return self._names.get(model, {}).get(re.sub(r" \(\d+\)$", "", name))

    def families_of(self, name: str) -> dict[str, tuple[str, ...]]:
        """Return the forms with variants that list an object; none for an added object."""
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
        """Add an object and return its name, made unique."""
        name = unique_name(added.name, self)
        self._added[name] = replace(added, name=name)
        self.version += 1
        return name

    def replace(self, name: str, better: EditableObject) -> None:
        """Replace an added object, keeping its name."""
        self._added[name] = replace(better, name=name)
        self.version += 1

    def rename(self, name: str, to: str) -> str:
        """Rename an added object and return the new name, made unique."""
        to = unique_name(to, self)
        self._added = {
            to if key == name else key: replace(one, name=to) if key == name else one
            for key, one in self._added.items()
        }
        self.version += 1
        return to

    def remove(self, *names: str) -> None:
        """Remove added objects from all lists."""
        self.removed |= frozenset(names)
        self.version += 1

    def add_missing(self, others: Iterable[EditableObject]) -> dict[str, str]:
        """Add objects whose codes no earlier added object has, one for one; map their names to the names here."""
        before, names = list(self.ever_added), dict[str, str]()
        for other in others:
            same = [one for one in before if one.codes == other.codes]
            found = min(same, key=lambda one: one.name != other.name, default=None)
            if found:
                before.remove(found)
            names[other.name] = found.name if found else self.add(other)
        return names


def unique_name(wanted: str, taken: Container[str]) -> str:
    """Return the wanted name, with a number if it is taken."""
    name, count = (wanted := printable(wanted)), 1
    while name in taken:
        count += 1
        name = f"{wanted} ({count})"
    return name
