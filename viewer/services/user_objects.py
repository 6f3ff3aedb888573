"""Fitted objects kept between launches, a file each."""

import json
import re
import secrets
import threading
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from core.models.missing import adopted
from core.models.model import Instance, Model
from core.models.open_models import OpenModels
from core.models.scene import Scene, scene_model
from core.runtime.files import atomic_file
from core.runtime.reading import optional, parse_json, read_text, reading, typed
from viewer.values import orbit
from viewer.values.objects import EditableObject, unique_key, unique_name


class _Stored(NamedTuple):
    path: Path
    content: EditableObject
    has_key: bool = True  # False: an older file, to be written again, as its key is the time of its last change


class UserObjects:
    """Stores each fitted object as a named scene file, which opens like any scene."""

    def __init__(self, folder: Path | None = None) -> None:
        """Store in ``folder``; None stores nothing."""
        self._folder = folder
        self._stored: dict[str, _Stored] = {}  # by key of the object
        self._lock = threading.Lock()  # held while files are written

    def model_files(self) -> dict[str, str]:
        """Return the names or paths of the models of all stored objects, by fingerprint; "" if not stored."""
        files = self._folder.glob("*.json") if self._folder else ()
        return {model: _fields(path).model_file for path in files if (model := scene_model(path))}

    def open(self, models: OpenModels) -> tuple[EditableObject, ...]:
        """Return the stored objects, the oldest first, also those of missing models; unreadable files are skipped."""

        def adopt(instance: Instance) -> Instance:
            model = models.find(instance.fingerprint)
            return adopted(model, instance) if model else instance

        with self._lock:
            self._stored = {}
            names = dict[str, str]()  # by name in the file: another window may have used the same name
            files = self._folder.glob("*.json") if self._folder else ()
            read = [(path, content) for path in files if (content := optional(partial(_read, path, adopt)))]
            taken = set[str]()
            for path, content in sorted(read, key=lambda entry: int(entry[1].key)):
                names[content.name] = unique_name(content.name, taken)
                taken.add(names[content.name])
                item = replace(content.renamed(names), key=unique_key(content.key, self._stored))
                self._stored[item.key] = _Stored(path, item, bool(_fields(path).key))
            return tuple(stored.content for stored in self._stored.values())

    def sync(self, models: OpenModels, objects: Iterable[EditableObject]) -> None:
        """Store new and changed objects of open models, and delete the files of objects that are not given any more.

        Raises ``ValueError`` or ``OSError`` on failure.
        """
        if self._folder is None:
            return
        with self._lock:
            kept = {item.key: item for item in objects}
            for item in kept.values():
                self._keep(models, item, self._folder)
            for key in self._stored.keys() - kept.keys():
                self._stored.pop(key).path.unlink(missing_ok=True)

    def update(self, models: OpenModels, objects: Iterable[EditableObject]) -> None:
        """Store the edits of stored objects, on any thread; other objects stay as they are. Raises as :meth:`sync`."""
        if self._folder is None:
            return
        with self._lock:
            for item in objects:
                if item.key in self._stored:
                    self._keep(models, item, self._folder)

    def _keep(self, models: OpenModels, item: EditableObject, folder: Path) -> None:
        """Store an object unless its file has it, or its model is missing."""
        stored = self._stored.get(item.key)
        is_new = stored is None or not stored.has_key or not _is_same(stored.content, item)
        if is_new and not any(instance.is_missing for instance in item.ends):
            path = stored.path if stored else folder / _file_name(item.name)
            model = item.instance.model
            _write(path, item, model, models.files.get(model.fingerprint, ""))
            self._stored[item.key] = _Stored(path, item)


def _is_same(first: EditableObject, second: EditableObject) -> bool:
    same = first.instance is second.instance and first.unedited is second.unedited
    values = attrgetter("name", "confidence", "version_of")
    return same and values(first) == values(second)


def _file_name(name: str) -> str:
    """Return a unique file name that every system accepts."""
    return f"{re.sub(r'[^A-Za-z0-9]+', '-', name)[:40].strip('-').lower()}-{secrets.token_hex(3)}.json"


def _write(path: Path, item: EditableObject, model: Model, model_file: str) -> None:
    fields = _scene(item.instance, model)
    fields |= {
        "name": item.name,
        "confidence": item.confidence,
        "model_file": model_file,
        "version_of": item.version_of,
        "key": item.key,
    }
    if item.unedited:
        fields["unedited"] = _scene(item.unedited, model)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(path, partial(_read, adopt=partial(adopted, model))) as written:
        written.write_text(json.dumps(fields))


def _scene(instance: Instance, model: Model) -> dict:
    return json.loads(Scene(instance, orbit.home(model)).to_json())


class _Fields(NamedTuple):
    """JSON fields of an object beside its scene."""

    name: str
    confidence: float | None = None
    unedited: dict | None = None  # scene of the object as fitted, if it was edited
    model_file: str = ""  # name or path of its model
    version_of: str = ""  # key of the object that it is a version of; in older files its name
    key: str = ""  # "" in older files, which were made when they were changed last


def _fields(path: Path) -> _Fields:
    """Return the fields of a file; empty ones if it is unreadable."""
    return optional(lambda: typed(_Fields, parse_json(read_text(path)), name="object")) or _Fields("")


def _read(path: Path, adopt: Callable[[Instance], Instance]) -> EditableObject:
    with reading(path, "an object"):
        text = read_text(path)
        fields = typed(_Fields, parse_json(text), name="object")
        instance = adopt(Scene.without_model(text).instance)
        unedited = fields.unedited and adopt(Scene.without_model(json.dumps(fields.unedited)).instance)
        if unedited and unedited.detail == instance.detail:
            unedited = unedited.changed(detail=instance.detail)  # photos take memory
        key = fields.key or str(path.stat().st_mtime_ns)
        return EditableObject(fields.name, instance, True, fields.confidence, unedited, fields.version_of, key)
