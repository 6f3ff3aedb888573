"""The objects of a session: the training objects of open models, and added objects."""

import re
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass, replace
from operator import attrgetter

import torch

from core.models.model import Instance, Model
from viewer.values.printable import printable
from viewer.values.variety import families


@dataclass(frozen=True, eq=False)
class EditableObject:
    """An object that can be shown and mixed. An added object keeps its edits and the codes before them."""

    name: str
    instance: Instance  # as the object was left
    fitted: bool = False  # to a photo
    confidence: float | None = None  # probability, 0..1, that the photo's camera is right; None: unknown
    unedited: Instance | None = None  # as fitted or opened; None: as left

    def __post_init__(self) -> None:
        if self.confidence is not None and not 0 <= self.confidence <= 1:
            raise ValueError(f"a confidence is 0 to 1, got {self.confidence}")

    @property
    def original(self) -> Instance:
        """The codes as fitted or opened."""
        return self.unedited or self.instance

    @property
    def versions(self) -> tuple[Instance, Instance]:
        """The codes as fitted or opened, and as left."""
        return self.original, self.instance

    def left_as(self, instance: Instance) -> "EditableObject":
        """Return the object with its newest edit."""
        return replace(self, instance=instance, unedited=None if instance == self.original else self.original)

    def refitted(self, better: "EditableObject") -> "EditableObject":
        """Return the object with the codes and the confidence of a better fit; its edits stay."""
        left = replace(better, name=self.name)
        return left.left_as(self.instance) if self.unedited else left


class ObjectLibrary:
    """Objects by name: the models' training objects that did not collapse, and added objects."""

    def __init__(self, models: Iterable[Model]) -> None:
        self._trained: dict[str, EditableObject] = {}
        self._added: dict[str, EditableObject] = {}
        self.removed: frozenset[str] = frozenset()  # names of unlisted added objects, which undo may list again
        self.version = 0  # number of changes so far
        self._names: dict[str, dict[str, str]] = {}  # by model's fingerprint: names here by names in the model
        self.families: dict[str, dict[str, tuple[str, ...]]] = {}
        """By model's fingerprint: one object of each form with its variants, the most different forms first."""
        for model in models:
            self.add_model(model)

    def add_model(self, model: Model) -> None:
        """Add the objects that a model was trained on, or its mean object if there are none."""
        book, names = model.codes, dict[str, str]()
        objects = [(book.objects[index].name, model[index]) for index in book.valid] or [("mean", model.mean)]
        for wanted, instance in objects:
            names[unique_name(wanted, names)] = name = unique_name(wanted, self)
            self._trained[name] = EditableObject(name, instance)
        groups = families(list(names), torch.stack([instance.codes.shape for _, instance in objects]))
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
        if name in self and self[name].instance.fingerprint == model:
            return name
        return self._names.get(model, {}).get(re.sub(r" \(\d+\)$", "", name))

    def families_of(self, name: str) -> dict[str, tuple[str, ...]]:
        """Return the families (:attr:`families`) of an object's model; none for an added object."""
        return {} if name in self._added else self.families[self[name].instance.fingerprint]

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

    def refit(self, name: str, better: EditableObject) -> None:
        """Give an added object the codes of a better fit."""
        self._added[name] = self._added[name].refitted(better)
        self.version += 1

    def convert(self, change: Callable[[Instance], Instance]) -> None:
        """Change the codes of added objects, also those before their edits."""
        for name, one in self._added.items():
            instance = change(one.instance)
            if instance is not one.instance:
                self._added[name] = replace(one, instance=instance, unedited=one.unedited and change(one.unedited))
        self.version += 1

    def leave(self, name: str, instance: Instance) -> None:
        """Keep the newest edit of an added object; nothing happens for any other object."""
        if name in self._added and self._added[name].instance != instance:
            self._added[name] = self._added[name].left_as(instance)

    def unlist(self, removed: frozenset[str]) -> None:
        """List all added objects but the removed ones; lookup by name finds these too."""
        if removed != self.removed:
            self.removed = removed
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

    def match(self, others: Iterable[EditableObject]) -> dict[str, str]:
        """Add the objects that are not here yet, and return the names here by the names given.

        Equal fits are one object, even if it was edited here or there. Each earlier object matches at most one.
        """
        before, names = list(self.ever_added), dict[str, str]()
        others = tuple(others)
        for key in (attrgetter("versions"), attrgetter("original")):
            for other in others:
                equal = [one for one in before if other.name not in names and key(one) == key(other)]
                if equal:
                    nearest = min(equal, key=lambda one: one.name != other.name)
                    before.remove(nearest)
                    names[other.name] = nearest.name
        return {other.name: names.get(other.name) or self.add(other) for other in others}


def unique_name(wanted: str, taken: Container[str]) -> str:
    """Return the wanted name, printable, with a number if it is taken."""
    name, count = (wanted := printable(wanted)), 1
    while name in taken:
        count += 1
        name = f"{wanted} ({count})"
    return name
