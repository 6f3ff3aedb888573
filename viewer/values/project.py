"""A project: everything a person made, as a value and as a zip of JSON, tensors and photos."""

import json
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import torch
from safetensors.torch import load, save

from core.models.open_models import OpenModels
from core.models.scene import Scene
from core.runtime.files import atomic_file
from core.runtime.reading import open_zip, parse_json, read_bytes, reading, typed
from viewer.values import orbit
from viewer.values.encoding import BlobStore, Original, decode, encode, readable
from viewer.values.fit_history import FitHistory, FitRequest
from viewer.values.history import History, Mix, Pair, State, Step
from viewer.values.objects import EditableObject, unique_name

SUFFIX = ".codenerf"
_JSON, _TENSORS = "project.json", "tensors.safetensors"
_ANY_FORMAT = "codenerf-project-"
_FORMATS = tuple(f"codenerf-project-{version}" for version in (1, 2, 3, 4, 5))  # known ones, the newest last
_MAX_ORIGINAL = 50_000_000  # limit of a file that is kept because something in it could not be read
_MAX_BYTES = 100_000_000  # limit of the unpacked content; a day's work takes a few million bytes


@dataclass(frozen=True, eq=False)
class Project:
    """Everything needed to resume a session."""

    history: History
    objects: tuple[EditableObject, ...] = ()  # added objects, also removed ones, the oldest first
    fit: FitHistory = field(default_factory=FitHistory)  # the last finished fit
    pending: tuple[FitRequest, ...] = ()  # the running fit and the waiting ones
    models: tuple[str, ...] = ()  # names and paths of the open models
    model_files: dict[str, str] = field(default_factory=dict)  # the same, and of missing models, by fingerprint
    originals: tuple[Original, ...] = ()  # files of which something could not be read
    path: Path | None = None  # file that a person saved it to, only in autosaved sessions

    @property
    def is_empty(self) -> bool:
        """True if nothing was made, edited or begun."""
        made = len(self.history.steps) > 1 or self.fit.sources or self.pending
        return not (made or self.objects or self.originals)

    def shared(self) -> "Project":
        """Return the project for other machines: paths are names, except those of photos not yet read."""
        return replace(self._moved(lambda path: Path(path.name)), path=None)

    def beside(self, folder: Path) -> "Project":
        """Return the project with photos located by name in a folder, if they are there."""
        return self._moved(lambda path: folder / path if (folder / path).is_file() else path)

    def after(self, earlier: "Project") -> "Project":
        """Return both projects as one: the states of ``earlier`` come first; its objects are renamed on a clash."""
        taken = {item.name for item in self.objects}
        names = dict[str, str]()
        for item in earlier.objects:
            names[item.name] = unique_name(item.name, taken)
            taken.add(names[item.name])
        history = self.history.after(earlier.history.renamed(names))
        removed = frozenset[str]().union(*(state.removed for state, _ in history.steps))
        return replace(
            self,
            history=history.everywhere(lambda state: replace(state, removed=removed)),
            objects=(*(added.renamed(names) for added in earlier.objects), *self.objects),
            fit=self.fit if self.fit.sources else earlier.fit,
            pending=(*self.pending, *earlier.pending),
            model_files=earlier.model_files | self.model_files,
        )

    def save(self, path: Path, models: OpenModels) -> None:
        """Write the project atomically. Raises ``ValueError`` if it cannot be written or read back."""
        store = BlobStore()
        bare = replace(self, fit=_shortened(self.fit), pending=tuple(map(_request, self.pending)))
        record = {"format": _FORMATS[-1], "project": encode(bare, store), "timelines": store.timelines}
        with atomic_file(path, partial(_check, models=models)) as written, zipfile.ZipFile(written, "w") as file:
            file.writestr(_JSON, json.dumps(record), zipfile.ZIP_DEFLATED)
            # Cloned because safetensors refuses tensors that share memory.
            file.writestr(_TENSORS, save({str(number): tensor.clone() for number, tensor in enumerate(store.tensors)}))
            for number, photo in enumerate(store.photos):
                file.writestr(_photo(number), photo)

    @classmethod
    def load(cls, path: Path, models: OpenModels) -> "Project":
        """Read a project and open its models.

        Objects of a missing model stay as they are. If another part cannot be read, the project is without it and holds
        the whole file as one of its :attr:`originals`. Raises ``ValueError`` if the file is damaged as a whole.
        """
        with reading(path, "a project"):
            store = BlobStore(models=models)
            project = _read(path, store, open_models=True)
            if not store.unreadable:
                return project
            original = Original(path.name, tuple(dict.fromkeys(store.unreadable)), read_bytes(path, _MAX_ORIGINAL))
            return replace(project, originals=(*project.originals, original))

    def _moved(self, move: Callable[[Path], Path]) -> "Project":
        """Apply ``move`` to the paths of photos that were read."""
        pending = tuple(request._replace(history=_moved(request.history, move)) for request in self.pending)
        return replace(self, fit=_moved(self.fit, move), pending=pending)


class _ProjectJson(NamedTuple):
    """The JSON of a project.

    The first format had a session per model instead of one project, the second a history without branches, the third
    objects without a size, the fourth objects without moves, bends and paints, and versions that name their object
    instead of holding its key.
    """

    format: str
    timelines: list
    project: dict | None = None  # since the second format
    model: str = ""  # first format: the current model
    sessions: tuple[dict, ...] = ()  # first format
    path: Path | None = None  # first format


def _check(path: Path, models: OpenModels) -> None:
    """Raise ``ValueError`` if a written project cannot be read back completely."""
    store = BlobStore(models=models)
    _read(path, store, open_models=False)
    if store.unreadable:
        raise ValueError(store.unreadable[0])


def _read(path: Path, store: BlobStore, open_models: bool) -> Project:
    """Read a project without its unreadable parts, for which the store has the reasons."""
    assert store.models is not None
    with open_zip(path, _MAX_BYTES) as file:
        record = typed(_ProjectJson, parse_json(file.read(_JSON)), name="project")
        if not record.format.startswith(_ANY_FORMAT):
            raise ValueError(f"{record.format} is no format of this program")
        if record.format not in _FORMATS:
            store.unreadable.append("a newer version of this program has written it")
        tensors = load(file.read(_TENSORS))
        store.tensors = [tensors[str(number)] for number in range(len(tensors))]
        count = sum(name.startswith("photos/") for name in file.namelist())
        members = (partial(file.read, _photo(number)) for number in range(count))
        store.photos = [readable(store, member) or b"" for member in members]
    store.timelines = record.timelines
    if open_models:
        models = {"models": [session["model"] for session in record.sessions]}
        _open_models(record.project or models, store.models, path.parent)
    project = _first_format(record, store) if record.project is None else _decoded(record.project, store)
    if open_models:
        _expect_missing(project.models, store)
    return project


def _open_models(record: dict, models: OpenModels, folder: Path) -> None:
    """Open the models of a project from their files, or from files of the same name beside the project."""
    for fingerprint, name in decode(dict[str, str], record.get("model_files", {}), BlobStore()).items():
        models.expect(fingerprint, name)
    for name in decode(tuple[str, ...], record.get("models", []), BlobStore()):
        for path in (name, str(folder / Path(name).name)):
            with suppress(ValueError):
                models.open(path)
                break


def _expect_missing(names: tuple[str, ...], store: BlobStore) -> None:
    """Note the likely files of missing models, which older projects list without fingerprints."""
    assert store.models is not None
    likely = " or ".join(name for name in names if name not in store.models.names)
    for fingerprint in store.missing - store.models.files.keys():
        store.models.expect(fingerprint, likely)


def _decoded(record: dict, store: BlobStore) -> Project:
    """Decode a project without its unreadable parts."""
    history = _decode_history(record, store)
    fit = readable(store, lambda: _checked(decode(FitHistory, record.get("fit", {}), store)))
    project: Project = decode(Project, record | {"history": {"steps": []}, "fit": {}}, store)
    pending = [request for request in project.pending if readable(store, partial(_checked, request.history))]
    return replace(project, history=history, fit=fit or FitHistory(), pending=tuple(pending))


def _decode_history(record: dict, store: BlobStore) -> History:
    """Decode a project's history without unreadable states; readable ones are consecutive if they are no tree."""
    stored = _branching(record, store)
    steps = _listed(stored, "steps", store)
    states = [readable(store, partial(_decode_state, step, store)) for step in steps]
    unreadable = {number for number, state in enumerate(states) if state is None}
    if len(unreadable) == len(states):
        return History.of(_first_state(store))
    substitute = next(filter(None, states))  # in place of unreadable ones
    states = [state or substitute for state in states]
    return (readable(store, partial(_tree, stored, states)) or History.of(*states)).without(unreadable)


def _decode_state(step: dict, store: BlobStore) -> State:
    return decode(State, step["state"], store)


def _tree(stored: dict, states: list[State]) -> History:
    """Return states as the stored tree. Raises ``ValueError`` if it is none."""
    steps = enumerate(stored["steps"])
    parents = [step.get("parent") if isinstance(step, dict) else number - 1 for number, step in steps]
    parents = typed(tuple[int, ...], parents, name="parents")
    current, tip = (typed(int, stored.get(name, 0), name=name) for name in ("current", "tip"))
    history = History(tuple(map(Step, states, parents)), current, tip)
    history.check()
    return history


def _first_state(store: BlobStore) -> State:
    """Return a state that shows the first object of the first open model."""
    assert store.models is not None
    model = next(iter(store.models))
    name = model.codes.first_name
    return State(Scene(model.first, orbit.home(model)), Mix(Pair(name, name), name), is_a=True)


def _branching(record: dict, store: BlobStore) -> dict:
    """Return a project's history; of the first two formats, with consecutive states and removed objects beside it."""
    history: dict = typed(dict, record.get("history", {}), name="history")
    if "steps" in history:
        return history
    past, future = (_listed(history, name, store) for name in ("past", "future"))
    later = {"removed": _listed(record, "removed", store), "is_a": None}
    states = [state | later if isinstance(state, dict) else state for state in (*past, history.get("now"), *future)]
    steps = [{"state": state, "parent": number - 1} for number, state in enumerate(states)]
    return {"steps": steps, "current": len(past), "tip": len(steps) - 1}


def _listed(record: dict, name: str, store: BlobStore) -> list:
    """Return a list in JSON; an empty one if it is missing or unreadable."""
    return readable(store, partial(typed, list, record.get(name, []), name=name)) or []


def _first_format(record: _ProjectJson, store: BlobStore) -> Project:
    """Join the sessions of all models; the current model's comes last."""
    project: Project | None = None
    for session in sorted(record.sessions, key=lambda session: session["model"] == record.model):
        if decoded := readable(store, partial(_session_of_first_format, session, record.path, store)):
            project = decoded.after(project) if project else decoded
    if project is None:
        raise ValueError(*store.unreadable[:1] or ("the project is empty",))
    return project


def _session_of_first_format(session: dict, path: Path | None, store: BlobStore) -> Project:
    """Decode the session of one model, whose fingerprint its codes lack."""
    assert store.models is not None
    store.model = session["history"]["now"]["scene"]["model"]
    project = _decoded(_completed(session, store) | {"models": [session["model"]]}, store)
    model = store.models.find(store.model)
    fingerprint = model.fingerprint if model else store.model  # the open model may extend the stored one
    pending = tuple(request._replace(history=_of_model(request.history, fingerprint)) for request in project.pending)
    return replace(project, fit=_of_model(project.fit, fingerprint), pending=pending, path=path)


def _completed(value: Any, store: BlobStore) -> Any:
    """Add fields that the oldest files lack to JSON of the first format."""
    if isinstance(value, list):
        return [_completed(item, store) for item in value]
    if not isinstance(value, dict):
        return value
    record = {name: _completed(item, store) for name, item in value.items()}
    if {"name", "codes", "photo"} <= record.keys() and not isinstance(record["photo"], str):
        record["fitted"] = record["photo"] is not None  # an object held its photo
    if {"origin", "cameras"} <= record.keys() and "crop_transform" not in record and "step" not in record:
        record["crop_transform"] = len(store.tensors)
        store.tensors.append(torch.zeros(len(record["cameras"]), 4))
    return record


def _of_model(fit: FitHistory, model: str) -> FitHistory:
    return replace(fit, model=model if fit.photos else "")


def _photo(number: int) -> str:
    return f"photos/{number}.png"


def _moved(fit: FitHistory, move: Callable[[Path], Path]) -> FitHistory:
    """Apply ``move`` to the paths of photos that were read; the other paths stay."""
    read = [source._replace(path=move(source.path), copy=None) for source in fit.sources]
    read = read[: len(fit.photos)]
    photos = tuple(replace(photo, source=source) for photo, source in zip(fit.photos, read, strict=True))
    return replace(fit, sources=(*read, *fit.sources[len(read) :]), photos=photos)


def _checked(fit: FitHistory) -> FitHistory:
    """Return a fit. Raises ``ValueError`` if its cameras differ in image size from its photos."""
    sizes = {fitted.pixels.shape[1::-1] for fitted in fit.photos}
    for step in fit.steps:
        for result in (step, *step.hypotheses, step.runner_up):
            if result and not {(camera.width, camera.height) for camera in result.cameras} <= sizes:
                raise ValueError("the cameras have another size than the photos")
    return fit


def _shortened(fit: FitHistory) -> FitHistory:
    """Return a fit in which every step but the last has only its best hypothesis."""
    steps = tuple(replace(step, hypotheses=step.hypotheses[:1]) for step in fit.steps[:-1])
    return replace(fit, steps=(*steps, *fit.steps[-1:]))


def _request(request: FitRequest) -> FitRequest:
    return request._replace(history=_shortened(request.history))
