"""Fitted objects kept between launches, a file each."""

import json
import os
import re
import secrets
import threading
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from core.models.missing import adopted
from core.models.model import Instance, Model
from core.models.open_models import OpenModels
from core.models.scene import Scene, scene_model
from core.runtime.files import atomic_file
from core.runtime.reading import optional, parse_json, read_text, reading, typed
from viewer.values import orbit
from viewer.values.objects import EditableObject, unique_name


class _Stored(NamedTuple):
    path: Path
    about: EditableObject


class UserObjects:
    """Stores each fitted object as a named scene file, which opens like any scene."""

    def __init__(self, folder: Path | None = None) -> None:
        """Store in ``folder``; None stores nothing."""
        self._folder = folder
        self._stored: dict[str, _Stored] = {}  # stored objects of opened models, by name
        self._lock = threading.Lock()  # held while files are written

    def model_files(self) -> dict[str, str]:
        """Return the names or paths of the models of all stored objects, by fingerprint; "" if not stored."""
        files = self._folder.glob("*.json") if self._folder else ()
        return {model: _model_file(path) for path in files if (model := scene_model(path))}

    def open(self, model: Model) -> tuple[EditableObject, ...]:
        """Return a model's stored objects, the oldest first; unreadable files are skipped."""
        return self._read_again(partial(adopted, model), lambda instance: model.shares_codes_with(instance.fingerprint))

    def missing(self, models: OpenModels) -> tuple[EditableObject, ...]:
        """Return the stored objects whose models are missing, the oldest first."""

        def unchanged(instance: Instance) -> Instance:
            if models.find(instance.fingerprint):
                raise ValueError("its model is open")
            return instance

        return self._read_again(unchanged, lambda instance: models.find(instance.fingerprint) is None)

    def _read_again(
        self, adopt: Callable[[Instance], Instance], is_wanted: Callable[[Instance], bool]
    ) -> tuple[EditableObject, ...]:
        """Return the objects of all files but unreadable ones and those that ``adopt`` refuses."""
        with self._lock:
            self._stored = {name: one for name, one in self._stored.items() if not is_wanted(one.about.instance)}
            objects = list[EditableObject]()
            names = dict[str, str]()  # by name in the file: another window may have used the same name
            files = self._folder.glob("*.json") if self._folder else ()
            for path in sorted(files, key=lambda path: path.stat().st_mtime):
                if stored := optional(partial(_read, path, adopt)):
                    name = unique_name(stored.name, self._stored)
                    names[stored.name] = name
                    objects.append(
                        replace(stored, name=name, version_of=names.get(stored.version_of, stored.version_of))
                    )
                    self._stored[name] = _Stored(path, objects[-1])
            return tuple(objects)

    def sync(self, models: OpenModels, objects: Iterable[EditableObject]) -> None:
        """Store new and changed objects of open models, and delete the files of other objects that were read.

        Raises ``ValueError`` or ``OSError`` on failure.
        """
        if self._folder is None:
            return
        with self._lock:
            wanted = {one.name: one for one in objects}
            for one in wanted.values():
                self._keep(models, one, self._folder)
            originals = {id(one.original) for one in wanted.values()}
            for name in self._stored.keys() - wanted.keys():
                its = self._stored[name].about.original
                if models.find(its.fingerprint) or id(its) not in originals:  # else it has another name here
                    self._stored.pop(name).path.unlink(missing_ok=True)

    def update(self, models: OpenModels, objects: Iterable[EditableObject]) -> None:
        """Store the edits of stored objects, on any thread; other objects stay as they are. Raises as :meth:`sync`."""
        if self._folder is None:
            return
        with self._lock:
            for one in objects:
                stored = self._stored.get(one.name)
                if stored and stored.about.original == one.original:
                    self._keep(models, one, self._folder)

    def _keep(self, models: OpenModels, one: EditableObject, folder: Path) -> None:
        """Store an object unless its file has it, or its model is missing."""
        stored = self._stored.get(one.name)
        is_new = stored is None or not _is_same(stored.about, one)
        if is_new and not any(instance.is_missing for instance in one.ends):
            path = stored.path if stored else folder / _file_name(one.name)
            model = one.instance.model
            _write(path, one, model, models.files.get(model.fingerprint, ""))
            self._stored[one.name] = _Stored(path, one)


def _is_same(first: EditableObject, second: EditableObject) -> bool:
    same = first.instance is second.instance and first.unedited is second.unedited
    return same and (first.confidence, first.version_of) == (second.confidence, second.version_of)


def _file_name(name: str) -> str:
    """Return a unique file name that every system accepts."""
    return f"{re.sub(r'[^A-Za-z0-9]+', '-', name)[:40].strip('-').lower()}-{secrets.token_hex(3)}.json"


def _write(path: Path, one: EditableObject, model: Model, model_file: str) -> None:
    about = _scene(one.instance, model)
    about |= {"name": one.name, "confidence": one.confidence, "model_file": model_file, "version_of": one.version_of}
    if one.unedited:
        about["unedited"] = _scene(one.unedited, model)
    path.parent.mkdir(parents=True, exist_ok=True)
    before = path.stat() if path.exists() else None
    with atomic_file(path, partial(_read, adopt=partial(adopted, model))) as written:
        written.write_text(json.dumps(about))
    if before:  # an edited object keeps its place in the order
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def _scene(instance: Instance, model: Model) -> dict:
    return json.loads(Scene(instance, orbit.home(model)).to_json())


class _About(NamedTuple):
    """JSON fields of an object beside its scene."""

    name: str
    confidence: float | None = None
    unedited: dict | None = None  # scene of the object as fitted, if it was edited
    model_file: str = ""  # name or path of its model
    version_of: str = ""  # name of the object that it is a version of


def _model_file(path: Path) -> str:
    about = optional(lambda: typed(_About, parse_json(read_text(path)), name="object"))
    return about.model_file if about else ""


def _read(path: Path, adopt: Callable[[Instance], Instance]) -> EditableObject:
    with reading(path, "an object"):
        text = read_text(path)
        about = typed(_About, parse_json(text), name="object")
        instance = adopt(Scene.without_model(text).instance)
        unedited = about.unedited and adopt(Scene.without_model(json.dumps(about.unedited)).instance)
        if unedited and unedited.detail == instance.detail:
            unedited = unedited.changed(detail=instance.detail)  # photos take memory
        return EditableObject(about.name, instance, True, about.confidence, unedited, about.version_of)
