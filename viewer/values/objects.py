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


class ObjectLibrary:
    """Objects by name: those of a model but its collapsed ones, and those that are added."""

    def __init__(self, model: Model) -> None:
        self._objects: dict[str, EditableObject] = {}
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
        names = list(self._objects)
        return names[self._trained :][::-1] + names[: self._trained]

    @property
    def added(self) -> tuple[EditableObject, ...]:
        """Those that are not the model's own, the oldest first: fitted, or opened."""
        return tuple(self._objects.values())[self._trained :]

    def add(self, added: EditableObject) -> str:
        """Take in an object; its name, which is made unique."""
        name, count = added.name, 1
        while name in self._objects:
            count += 1
            name = f"{added.name} ({count})"
        self._objects[name] = replace(added, name=name)
        return name
