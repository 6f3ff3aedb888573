"""The objects of a session: those the model was trained on, and those added since."""

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
    fitted: bool = False
    """to a photo"""
    confidence: float | None = None
    """the probability that the camera of that photo is right, 0..1; None where that is not known"""
    photo: str = ""
    """digest of that photo's pixels; empty where that is not known"""

    def __post_init__(self) -> None:
        if self.confidence is not None and not 0 <= self.confidence <= 1:
            raise ValueError(f"a confidence is 0 to 1, got {self.confidence}")


class ObjectLibrary:
    """Objects by name: those of a model but its collapsed ones, and those that are added."""

    def __init__(self, model: Model) -> None:
        self._objects: dict[str, EditableObject] = {}
        self.removed: frozenset[str] = frozenset()
        """which are in no list any more; they stay, as undo may come back to them"""
        self.version = 0
        """counts the changes"""
        for index in model.codes.valid:
            self.add(EditableObject(model.codes.objects[index].name, model.codes[index]))
        if not self._objects:
            self.add(EditableObject("mean", model.codes.mean))
        shapes = torch.stack([one.codes.shape for one in self._objects.values()])
        self.families = families(list(self._objects), shapes)
        """of the model's objects: one of each form, the most different forms first, and its variants"""
        self._trained = len(self._objects)

    def __getitem__(self, name: str) -> EditableObject:
        return self._objects[name]

    @property
    def names(self) -> list[str]:
        """Added objects first, the newest in front, then the model's own: one of each form, then the variants."""
        return [*self.own, *self.families, *(name for variants in self.families.values() for name in variants)]

    @property
    def own(self) -> list[str]:
        """The names of added objects, the newest in front."""
        return [one.name for one in reversed(self.added)]

    def __contains__(self, name: str) -> bool:
        return name in self._objects

    @property
    def added(self) -> tuple[EditableObject, ...]:
        """Those that are not the model's own, the oldest first: fitted, or opened."""
        return tuple(one for one in self.ever_added if one.name not in self.removed)

    @property
    def ever_added(self) -> tuple[EditableObject, ...]:
        """Those that were removed too."""
        return tuple(self._objects.values())[self._trained :]

    def add(self, added: EditableObject) -> str:
        """Take in an object; its name, which is made unique."""
        name = unique_name(added.name, self._objects)
        self._objects[name] = replace(added, name=name)
        self.version += 1
        return name

    def replace(self, name: str, better: EditableObject) -> None:
        """Put another object in the place of an added one; the name stays."""
        self._objects[name] = replace(better, name=name)
        self.version += 1

    def rename(self, name: str, to: str) -> str:
        """Give an added object another name, which is made unique; that name."""
        to = unique_name(to, self._objects)
        self._objects = {
            to if key == name else key: replace(one, name=to) if key == name else one
            for key, one in self._objects.items()
        }
        self.version += 1
        return to

    def remove(self, *names: str) -> None:
        """Take added objects out of all lists."""
        self.removed |= frozenset(names)
        self.version += 1

    def add_missing(self, others: Iterable[EditableObject]) -> dict[str, str]:
        """Take in those whose codes no added object has that was there before, each for one; by their names, the names
        that they have here.
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
    """A name that is not taken: the wanted one, or that with a number."""
    name, count = (wanted := printable(wanted)), 1
    while name in taken:
        count += 1
        name = f"{wanted} ({count})"
    return name
