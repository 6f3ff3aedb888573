"""A project: everything a person made, as a value and as a zip of JSON, tensors and photos."""

import json
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import torch
from safetensors.torch import load, save

from core.models.open_models import OpenModels
from core.runtime.files import atomic_file
from core.runtime.reading import open_zip, parse_json, reading, typed
from viewer.values.encoding import BlobStore, decode, encode
from viewer.values.fit_history import FitHistory, FitRequest
from viewer.values.history import History
from viewer.values.objects import EditableObject, unique_name

SUFFIX = ".codenerf"
_ABOUT, _TENSORS = "project.json", "tensors.safetensors"
_MAX_BYTES = 100_000_000  # limit of the unpacked content; a day's work takes a few million bytes


@dataclass(frozen=True, eq=False)
class Project:
    """Everything needed to resume a session."""

    history: History
    objects: tuple[EditableObject, ...] = ()  # added objects, also removed ones, the oldest first
    fit: FitHistory = field(default_factory=FitHistory)  # the last finished fit
    pending: tuple[FitRequest, ...] = ()  # the running fit and the waiting ones
    models: tuple[str, ...] = ()  # names and paths of the open models
    path: Path | None = None  # file that a person saved it to, only in autosaved sessions

    @property
    def is_empty(self) -> bool:
        """True if nothing was made, edited or begun."""
        return not (len(self.history.steps) > 1 or self.fit.sources or self.pending)

    def shared(self) -> "Project":
        """Return the project for other machines: paths are names, except those of photos not yet read."""
        return replace(self._moved(lambda path: Path(path.name)), path=None)

    def beside(self, folder: Path) -> "Project":
        """Return the project with photos located by name in a folder, if they are there."""
        return self._moved(lambda path: folder / path if (folder / path).is_file() else path)

    def after(self, earlier: "Project") -> "Project":
        """Return both projects as one: the states of ``earlier`` come first; its objects are renamed on a clash."""
        taken, names = {one.name for one in self.objects}, dict[str, str]()
        for one in earlier.objects:
            names[one.name] = unique_name(one.name, taken)
            taken.add(names[one.name])
        history = self.history.after(earlier.history.renamed(names))
        removed = frozenset[str]().union(*(state.removed for state, _ in history.steps))
        return replace(
            self,
            history=history.everywhere(lambda state: replace(state, removed=removed)),
            objects=(*(replace(one, name=names[one.name]) for one in earlier.objects), *self.objects),
            fit=self.fit if self.fit.sources else earlier.fit,
            pending=(*self.pending, *earlier.pending),
        )

    def save(self, path: Path, models: OpenModels) -> None:
        """Write the project atomically. Raises ``ValueError`` if it cannot be written or read back."""
        store = BlobStore()
        bare = replace(self, fit=_shortened(self.fit), pending=tuple(map(_request, self.pending)))
        about = {"format": "codenerf-project-3", "project": encode(bare, store), "timelines": store.timelines}
        with atomic_file(path, partial(Project.load, models=models)) as written, zipfile.ZipFile(written, "w") as file:
            file.writestr(_ABOUT, json.dumps(about), zipfile.ZIP_DEFLATED)
            # Cloned because safetensors refuses tensors that share memory.
            file.writestr(_TENSORS, save({str(number): one.clone() for number, one in enumerate(store.tensors)}))
            for number, photo in enumerate(store.photos):
                file.writestr(_photo(number), photo)

    @classmethod
    def load(cls, path: Path, models: OpenModels) -> "Project":
        """Read a project and open its models.

        Raises ``ValueError`` for a damaged file, or codes of a model that cannot be opened.
        """
        with reading(path, "a project"), open_zip(path, _MAX_BYTES) as file:
            about = typed(_About, parse_json(file.read(_ABOUT)), name="project")
            tensors = load(file.read(_TENSORS))
            count = sum(name.startswith("photos/") for name in file.namelist())
            photos = [file.read(_photo(number)) for number in range(count)]
            store = BlobStore([tensors[str(number)] for number in range(len(tensors))], photos, about.timelines, models)
            return _first_format(about, store) if about.project is None else _decoded(about.project, store)

    def _moved(self, move: Callable[[Path], Path]) -> "Project":
        """Apply ``move`` to the paths of photos that were read."""
        pending = tuple(one._replace(history=_moved(one.history, move)) for one in self.pending)
        return replace(self, fit=_moved(self.fit, move), pending=pending)


class _About(NamedTuple):
    """The JSON of a project.

    The first format had a session per model instead of one project, the second a history without branches.
    """

    format: Literal["codenerf-project-1", "codenerf-project-2", "codenerf-project-3"]
    timelines: list
    project: dict | None = None  # since the second format
    model: str = ""  # first format: the current model
    sessions: tuple[dict, ...] = ()  # first format
    path: Path | None = None  # first format


def _decoded(about: dict, store: BlobStore) -> Project:
    assert store.models is not None
    for name in about.get("models", ()):
        with suppress(ValueError):  # decoding codes of a missing model raises
            store.models.open(str(name))
    found: Project = decode(Project, _branching(about), store)
    found.history.check()
    for fit in (found.fit, *(request.history for request in found.pending)):
        _check_cameras(fit)
    return found


def _branching(about: dict) -> dict:
    """Convert the history of the first two formats: consecutive states, and removed objects beside them."""
    history = about["history"]
    if "steps" in history:
        return about
    removed = {"removed": about.get("removed", [])}
    states = [*history.get("past", ()), history["now"], *history.get("future", ())]
    steps = [{"state": state | removed, "parent": number - 1} for number, state in enumerate(states)]
    tree = {"steps": steps, "current": len(history.get("past", ())), "tip": len(steps) - 1}
    return about | {"history": tree}


def _first_format(about: _About, store: BlobStore) -> Project:
    """Join the sessions of all models; the current model's comes last."""
    assert store.models is not None
    found: Project | None = None
    for session in sorted(about.sessions, key=lambda one: one["model"] == about.model):
        store.model = session["history"]["now"]["scene"]["model"]  # which codes of this format lack
        one = _decoded(_completed(session, store) | {"models": [session["model"]]}, store)
        model = store.models[store.model].fingerprint  # of the open model, which may extend the stored one
        pending = tuple(request._replace(history=_of_model(request.history, model)) for request in one.pending)
        one = replace(one, fit=_of_model(one.fit, model), pending=pending, path=about.path)
        found = one.after(found) if found else one
    if found is None:
        raise ValueError("the project is empty")
    return found


def _completed(value: Any, store: BlobStore) -> Any:
    """Add fields that the oldest files lack to JSON of the first format."""
    if isinstance(value, list):
        return [_completed(one, store) for one in value]
    if not isinstance(value, dict):
        return value
    found = {name: _completed(one, store) for name, one in value.items()}
    if {"name", "codes", "photo"} <= found.keys() and not isinstance(found["photo"], str):
        found |= {"fitted": found["photo"] is not None}  # an object held its photo
    if {"origin", "cameras"} <= found.keys() and "crop_transform" not in found and "step" not in found:
        found["crop_transform"] = len(store.tensors)
        store.tensors.append(torch.zeros(len(found["cameras"]), 4))
    return found


def _of_model(fit: FitHistory, model: str) -> FitHistory:
    return replace(fit, model=model if fit.photos else "")


def _photo(number: int) -> str:
    return f"photos/{number}.png"


def _moved(fit: FitHistory, move: Callable[[Path], Path]) -> FitHistory:
    """Apply ``move`` to the paths of photos that were read; the other paths stay."""
    read = [one._replace(path=move(one.path)) for one in fit.sources]
    read = read[: len(fit.photos)]
    photos = tuple(replace(photo, source=source) for photo, source in zip(fit.photos, read, strict=True))
    return replace(fit, sources=(*read, *fit.sources[len(read) :]), photos=photos)


def _check_cameras(fit: FitHistory) -> None:
    """Raise ``ValueError`` if the cameras of a fit differ in image size from its photos."""
    sizes = {fitted.pixels.shape[1::-1] for fitted in fit.photos}
    for step in fit.steps:
        for cameras in (step.cameras, *(one.cameras for one in (*step.hypotheses, step.runner_up) if one)):
            if not {(camera.width, camera.height) for camera in cameras} <= sizes:
                raise ValueError("the cameras have another size than the photos")


def _shortened(fit: FitHistory) -> FitHistory:
    """Return a fit in which every step but the last has only its best hypothesis."""
    steps = tuple(replace(step, hypotheses=step.hypotheses[:1]) for step in fit.steps[:-1])
    return replace(fit, steps=(*steps, *fit.steps[-1:]))


def _request(request: FitRequest) -> FitRequest:
    return request._replace(history=_shortened(request.history))
