"""The objects of a session: those the model was trained on, and those added since."""

from dataclasses import dataclass, replace

from core.models.codes import Codes
from core.models.model import Model
from core.photos.photo import Photo


@dataclass(frozen=True, eq=False)
class EditableObject:
    """An object that can be shown and mixed."""

    name: str
    codes: Codes
    photo: Photo | None = None
    """what it was fitted to, if it was"""
    confidence: float | None = None
    """the probability that the camera of that photo is right, 0..1; None where that is not known"""


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
        self._trained = len(self._objects)

    def __getitem__(self, name: str) -> EditableObject:
        return self._objects[name]

    @property
    def names(self) -> list[str]:
        """Added objects first, the newest in front, then the model's own."""
        return [one.name for one in reversed(self.added)] + list(self._objects)[: self._trained]

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
        name = self._unique(added.name)
        self._objects[name] = replace(added, name=name)
        self.version += 1
        return name

    def replace(self, name: str, better: EditableObject) -> None:
        """Put another object in the place of an added one; the name stays."""
        self._objects[name] = replace(better, name=name)
        self.version += 1

    def rename(self, name: str, to: str) -> str:
        """Give an added object another name, which is made unique; that name."""
        to = self._unique(to)
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

    def _unique(self, wanted: str) -> str:
        name, count = wanted, 1
        while name in self._objects:
            count += 1
            name = f"{wanted} ({count})"
        return name
