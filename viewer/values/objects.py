"""The objects of a session: the training objects of open models, and added objects."""

import re
import time
from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import dataclass, replace

import torch

from core.models.model import Instance, Model
from core.runtime.numbers import abbreviated
from viewer.values.printable import printable
from viewer.values.state import State
from viewer.values.variety import families

_LONGEST_NAME = 200  # characters
_DIGITS = 20  # a key has fewer: ns until the year 2286 have 19


@dataclass(frozen=True, eq=False)
class EditableObject:
    """An object that can be shown and mixed. An added object keeps its edits and the codes before them."""

    name: str
    instance: Instance  # as the object was left
    fitted: bool = False  # to a photo
    confidence: float | None = None  # probability, 0..1, that the photo's camera is right; None: unknown
    unedited: Instance | None = None  # as fitted or opened; None: as left
    version_of: str = ""  # key of the object that it is a version of
    key: str = ""  # ns since 1970 when it was made: stays if it is renamed, and orders objects; "" until it is added

    def __post_init__(self) -> None:
        if self.confidence is not None and not 0 <= self.confidence <= 1:
            raise ValueError(f"a confidence is 0 to 1, got {self.confidence}")
        if self.key and not (self.key.isdecimal() and len(self.key) < _DIGITS):
            raise ValueError(f"an object's key is a number of ns, got {abbreviated(self.key)}")

    @property
    def original(self) -> Instance:
        """The codes as fitted or opened."""
        return self.unedited or self.instance

    @property
    def ends(self) -> tuple[Instance, Instance]:
        """The codes as fitted or opened, and as left."""
        return self.original, self.instance

    def renamed(self, names: Mapping[str, str]) -> "EditableObject":
        """Return the object with names replaced, from keys to values of ``names``."""
        name, root = (names.get(name, name) for name in (self.name, self.version_of))
        return replace(self, name=name, version_of=root)

    def left_as(self, instance: Instance) -> "EditableObject":
        """Return the object with its newest edit."""
        return replace(self, instance=instance, unedited=None if instance == self.original else self.original)

    def converted(self, change: Callable[[Instance], Instance]) -> "EditableObject":
        """Return the object with changed codes, also those before its edits; itself if they stay."""
        instance = change(self.instance)
        if instance is self.instance:
            return self
        return replace(self, instance=instance, unedited=self.unedited and change(self.unedited))

    def refitted(self, better: "EditableObject") -> "EditableObject":
        """Return the object with the codes and the confidence of a better fit; its edits stay."""
        left = replace(better, name=self.name, version_of=self.version_of, key=self.key)
        return left.left_as(self.instance) if self.unedited else left


class ObjectLibrary:
    """Objects by name: the models' training objects that did not collapse, and added objects."""

    def __init__(self, models: Iterable[Model]) -> None:
        self._trained: dict[str, EditableObject] = {}
        self._added: dict[str, EditableObject] = {}
        self._keys: dict[str, str] = {}  # names of added objects by key
        self.removed: frozenset[str] = (
            frozenset()
        )  # names of unlisted added objects, found by name; undo lists them again
        self._names: dict[str, dict[str, str]] = {}  # by model's fingerprint: names here by names in the model
        self.families: dict[str, dict[str, tuple[str, ...]]] = {}
        """By model's fingerprint: one object of each form with its variants, the most different forms first."""
        for model in models:
            self.add_model(model)

    def add_model(self, model: Model) -> None:
        """Add the objects that a model was trained on, or its mean object if there are none."""
        book = model.codes
        names = dict[str, str]()
        objects = [(book.objects[index].name, model[index]) for index in book.valid] or [("mean", model.mean)]
        for trained, instance in objects:
            names[unique_name(trained, names)] = name = unique_name(trained, self)
            self._trained[name] = EditableObject(name, instance)
        groups = families(list(names), torch.stack([instance.codes.shape for _, instance in objects]))
        self.families[model.fingerprint] = {
            names[head]: tuple(names[variant] for variant in variants) for head, variants in groups.items()
        }
        self._names[model.fingerprint] = names

    def __getitem__(self, name: str) -> EditableObject:
        return self._added[name] if name in self._added else self._trained[name]

    def __contains__(self, name: object) -> bool:
        return name in self._added or name in self._trained

    def is_missing(self, name: str) -> bool:
        """Return whether an object cannot be shown because its model is missing."""
        return any(instance.is_missing for instance in self[name].ends)

    def can_show(self, state: State) -> bool:
        """Return whether a state's model is open and its objects are here, all of that model."""
        model = state.scene.instance.fingerprint
        return not state.scene.instance.is_missing and all(
            name in self and self[name].instance.fingerprint == model and not self.is_missing(name)
            for name in state.mix.names
        )

    def is_added(self, name: str) -> bool:
        """Return whether an object was fitted or opened: it keeps its edits, and has versions."""
        return name in self._added

    @property
    def own(self) -> list[str]:
        """Names of added objects that were not removed, one of the versions of each, the newest first."""
        firsts = dict[str, str]()
        for added in self.added:
            firsts.setdefault(self.root(added.name), added.name)
        return [*reversed(firsts.values())]

    def root(self, name: str) -> str:
        """Return the name of the object that has this one as a version; its own name if it is no version."""
        return self._keys.get(self[name].version_of, name)

    def versions(self, name: str) -> list[str]:
        """Return the names of an added object's versions that were not removed, the oldest first."""
        root = self.root(name)
        return [added.name for added in self.added if self.root(added.name) == root]

    def states(self, name: str) -> list[Instance]:
        """Return an object as trained, fitted or opened, then its other versions as left, the oldest first."""
        states = [self[self.root(name)].original]
        for version in self.versions(name):
            instance = self[version].instance
            if instance not in states:
                states.append(instance)
        return states

    def named(self, name: str, instance: Instance) -> list[str]:
        """Return the names of an object's versions with some codes."""
        return [version for version in self.versions(name) if self[version].instance == instance]

    def version(self, name: str, instance: Instance) -> str:
        """Return the name of an object's version with some codes; it is added unless it is there."""
        return next(iter(self.named(name, instance)), "") or self._add_version(name, instance)

    def keep(self, name: str, instance: Instance) -> None:
        """Keep codes of an added object as a version that edits of the object leave; nothing for any other object."""
        if name not in self._added or name in self.removed or instance == self[self.root(name)].original:
            return
        if not set(self.named(name, instance)) - {name}:
            self._add_version(name, instance)

    def _add_version(self, name: str, instance: Instance) -> str:
        root = self[self.root(name)]
        return self.add(replace(self[name].left_as(instance), name=root.name, version_of=root.key, key=""))

    def name_here(self, name: str, fingerprint: str) -> str | None:
        """Return the name here of a model's object with this name in another session; None if there is none.

        The names differ if objects of two models share a name, as one of them gets a number.
        """
        if name in self and self[name].instance.fingerprint == fingerprint:
            return name
        return self._names.get(fingerprint, {}).get(re.sub(r" \(\d+\)$", "", name))

    def families_of(self, name: str) -> dict[str, tuple[str, ...]]:
        """Return the families (:attr:`families`) of an object's model; none for an added object."""
        return {} if name in self._added else self.families[self[name].instance.fingerprint]

    @property
    def added(self) -> tuple[EditableObject, ...]:
        """Added objects (fitted or opened) that were not removed, the oldest first."""
        return tuple(added for name, added in self._added.items() if name not in self.removed)

    @property
    def ever_added(self) -> tuple[EditableObject, ...]:
        """All added objects, including removed ones."""
        return tuple(self._added.values())

    def add(self, added: EditableObject) -> str:
        """Add an object under a unique name, with a unique key, and return that name."""
        name = unique_name(added.name, self)
        key = unique_key(added.key, self._keys)
        self._added[name] = replace(added, name=name, key=key)
        self._keys[key] = name
        return name

    def refit(self, name: str, better: EditableObject) -> None:
        """Give an added object the codes of a better fit."""
        self._added[name] = self._added[name].refitted(better)

    def convert(self, change: Callable[[Instance], Instance]) -> None:
        """Change the codes of added objects, also those before their edits."""
        self._added = {name: added.converted(change) for name, added in self._added.items()}

    def leave(self, name: str, instance: Instance) -> None:
        """Keep the newest edit of an added object; nothing happens for any other object."""
        if name in self._added and self._added[name].instance != instance:
            self._added[name] = self._added[name].left_as(instance)

    def rename(self, name: str, to: str) -> str:
        """Rename an added object and return its new name, made unique."""
        to = unique_name(to, self)
        renamed = (added.renamed({name: to}) for added in self._added.values())
        self._take({added.name: added for added in renamed})
        return to

    def match(self, incoming: Iterable[EditableObject]) -> dict[str, str]:
        """Add the objects that are not here yet, and return the names here by the names given.

        Objects with one key are the same, edited here or there, unless they were fitted differently: then two homes
        have made them.
        """
        names = dict[str, str]()
        keys = dict[str, str]()  # here, by the keys given
        for item in sorted(incoming, key=lambda item: bool(item.version_of)):
            here = self._added.get(self._keys.get(item.key, ""))
            root = item.version_of and keys.get(item.version_of, item.version_of)
            if here and here.original == item.original and here.version_of == root:
                names[item.name] = here.name
            else:
                names[item.name] = self.add(replace(item, version_of=root))
            keys[item.key] = self[names[item.name]].key
        self._take(dict(sorted(self._added.items(), key=lambda entry: int(entry[1].key))))
        return names

    def _take(self, added: dict[str, EditableObject]) -> None:
        """Replace the added objects by the same ones in another order or with other names."""
        self._added = added
        self._keys = {item.key: name for name, item in added.items()}


def unique_name(name: str, taken: Container[str]) -> str:
    """Return a name, printable, with a number if it is taken."""
    name = stem = printable(name)[:_LONGEST_NAME]
    count = 1
    while name in taken:
        count += 1
        name = f"{stem} ({count})"
    return name


def unique_key(key: str, taken: Container[str]) -> str:
    """Return a key, the next free one if it is taken; the time now in place of an empty one."""
    number = int(key or time.time_ns())
    while str(number) in taken:
        number += 1
    return str(number)
