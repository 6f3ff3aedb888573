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

from core.models.codes import Codes
from core.models.model import Model
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
        return self._read_again(model.adopt, lambda codes: model.shares_codes_with(codes.model))

    def missing(self, models: OpenModels) -> tuple[EditableObject, ...]:
        """Return the stored objects whose models are missing, the oldest first."""

        def unchanged(codes: Codes) -> Codes:
            if models.find(codes.model):
                raise ValueError("its model is open")
            return codes

        return self._read_again(unchanged, lambda codes: models.find(codes.model) is None)

    def _read_again(
        self, adopted: Callable[[Codes], Codes], is_wanted: Callable[[Codes], bool]
    ) -> tuple[EditableObject, ...]:
        """Return the objects of all files but unreadable ones and those that ``adopted`` refuses."""
        with self._lock:
            self._stored = {name: one for name, one in self._stored.items() if not is_wanted(one.about.codes)}
            found = list[EditableObject]()
            files = self._folder.glob("*.json") if self._folder else ()
            for path in sorted(files, key=lambda path: path.stat().st_mtime):
                if one := optional(partial(_read, path, adopted)):
                    name = unique_name(one.name, self._stored)  # another window may have used the same name
                    found.append(replace(one, name=name))
                    self._stored[name] = _Stored(path, found[-1])
            return tuple(found)

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
                if models.find(its.model) or id(its) not in originals:  # else it has another name here
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
        if is_new and all(map(models.can_show, one.versions)):
            path = stored.path if stored else folder / _file_name(one.name)
            model = models.of(one.codes)
            _write(path, one, model, models.files.get(model.fingerprint, ""))
            self._stored[one.name] = _Stored(path, one)


def _is_same(first: EditableObject, second: EditableObject) -> bool:
    same = first.codes is second.codes and first.unedited is second.unedited
    return same and first.confidence == second.confidence


def _file_name(name: str) -> str:
    """Return a unique file name that every system accepts."""
    return f"{re.sub(r'[^A-Za-z0-9]+', '-', name)[:40].strip('-').lower()}-{secrets.token_hex(3)}.json"


def _write(path: Path, one: EditableObject, model: Model, model_file: str) -> None:
    about = _scene(one.codes, model)
    about |= {"name": one.name, "confidence": one.confidence, "model_file": model_file}
    if one.unedited:
        about["unedited"] = _scene(one.unedited, model)
    path.parent.mkdir(parents=True, exist_ok=True)
    before = path.stat() if path.exists() else None
    with atomic_file(path, partial(_read, adopted=model.adopt)) as written:
        written.write_text(json.dumps(about))
    if before:  # an edited object keeps its place in the order
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def _scene(codes: Codes, model: Model) -> dict:
    return json.loads(Scene(codes, orbit.home(model)).to_json())


class _About(NamedTuple):
    """JSON fields of an object beside its scene."""

    name: str
    confidence: float | None = None
    unedited: dict | None = None  # scene of the object as fitted, if it was edited
    model_file: str = ""  # name or path of its model


def _model_file(path: Path) -> str:
    about = optional(lambda: typed(_About, parse_json(read_text(path)), name="object"))
    return about.model_file if about else ""


def _read(path: Path, adopted: Callable[[Codes], Codes]) -> EditableObject:
    with reading(path, "an object"):
        text = read_text(path)
        about = typed(_About, parse_json(text), name="object")
        codes = adopted(Scene.without_model(text).codes)
        unedited = about.unedited and adopted(Scene.without_model(json.dumps(about.unedited)).codes)
        if unedited and unedited.detail == codes.detail:
            unedited = replace(unedited, detail=codes.detail)  # photos take memory
        return EditableObject(about.name, codes, True, about.confidence, unedited)
