"""Fitted objects kept between launches, a file each."""

import json
import re
import secrets
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

    def model_files(self) -> dict[str, str]:
        """Return the names or paths of the models of all stored objects, by fingerprint; "" if not stored."""
        files = self._folder.glob("*.json") if self._folder else ()
        return {model: _model_file(path) for path in files if (model := scene_model(path))}

    def open(self, model: Model) -> tuple[EditableObject, ...]:
        """Return a model's stored objects, the oldest first; unreadable files are skipped."""
        others = self._stored.items()
        self._stored = {name: one for name, one in others if not model.shares_codes_with(one.about.codes.model)}
        return self._read_all(model.adopt)

    def missing(self, models: OpenModels) -> tuple[EditableObject, ...]:
        """Return the stored objects whose models are missing, the oldest first."""
        self._stored = {name: one for name, one in self._stored.items() if models.find(one.about.codes.model)}

        def unchanged(codes: Codes) -> Codes:
            if models.find(codes.model):
                raise ValueError("its model is open")
            return codes

        return self._read_all(unchanged)

    def _read_all(self, adopted: Callable[[Codes], Codes]) -> tuple[EditableObject, ...]:
        """Return the objects of all files but unreadable ones and those that ``adopted`` refuses."""
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
        wanted = {one.name: one for one in objects}
        for name, one in wanted.items():
            stored = self._stored.get(name)
            model = models.find(one.codes.model)
            if model and (stored is None or not _is_same(stored.about, one)):
                path = stored.path if stored else self._folder / _file_name(name)
                _write(path, one, model, models.files.get(model.fingerprint, ""))
                self._stored[name] = _Stored(path, one)
        codes = {id(one.codes) for one in wanted.values()}
        for name in self._stored.keys() - wanted.keys():
            its = self._stored[name].about.codes
            if models.find(its.model) or id(its) not in codes:  # else it has another name here
                self._stored.pop(name).path.unlink(missing_ok=True)


def _is_same(first: EditableObject, second: EditableObject) -> bool:
    return first.codes is second.codes and first.confidence == second.confidence


def _file_name(name: str) -> str:
    """Return a unique file name that every system accepts."""
    return f"{re.sub(r'[^A-Za-z0-9]+', '-', name)[:40].strip('-').lower()}-{secrets.token_hex(3)}.json"


def _write(path: Path, one: EditableObject, model: Model, model_file: str) -> None:
    scene = Scene(one.codes, orbit.home(model))
    about = {"name": one.name, "confidence": one.confidence, "model_file": model_file}
    about = json.loads(scene.to_json()) | about
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(path, partial(_read, adopted=model.adopt)) as written:
        written.write_text(json.dumps(about))


class _About(NamedTuple):
    """JSON fields of an object beside its scene."""

    name: str
    confidence: float | None = None
    model_file: str = ""


def _model_file(path: Path) -> str:
    about = optional(lambda: typed(_About, parse_json(read_text(path)), name="object"))
    return about.model_file if about else ""


def _read(path: Path, adopted: Callable[[Codes], Codes]) -> EditableObject:
    with reading(path, "an object"):
        text = read_text(path)
        about = typed(_About, parse_json(text), name="object")
        return EditableObject(about.name, adopted(Scene.without_model(text).codes), True, about.confidence)
