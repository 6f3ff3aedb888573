"""A project: one file with all that was made, with every model; a zip of JSON, tensors and photos."""

import json
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple

from safetensors.torch import load, save

from core.runtime.files import atomic_file
from core.runtime.reading import open_zip, parse_json, reading, typed
from viewer.values.encoding import Parts
from viewer.values.saved_session import SavedSession

SUFFIX = ".codenerf"
_FORMAT = "codenerf-project-1"
_ABOUT, _TENSORS = "project.json", "tensors.safetensors"
_MAX_BYTES = 100_000_000
"""of what is unpacked; a project of a day's work has some millions"""


@dataclass(frozen=True, eq=False)
class Project:
    """The sessions of all models with which something was made."""

    model: str
    """the name of the one that is open"""
    sessions: tuple[SavedSession, ...]
    path: Path | None = None
    """where a person saved it last, if it is what is kept from launch to launch"""

    @property
    def summary(self) -> str:
        """How many steps, objects and photos under way it holds; empty where it holds none."""
        counts = {
            ("step", "steps"): sum(len(one.history.past) + len(one.history.future) for one in self.sessions),
            ("object", "objects"): sum(
                len({each.name for each in one.objects} - {*one.removed}) for one in self.sessions
            ),
            ("photo under way", "photos under way"): sum(len(one.pending) for one in self.sessions),
        }
        return ", ".join(f"{count} {one if count == 1 else more}" for (one, more), count in counts.items() if count)

    def shared(self) -> "Project":
        """To be handed on: without the folders of this machine, except those of photos that have not been read yet."""
        return Project(self.model, tuple(session.moved(lambda path: Path(path.name)) for session in self.sessions))

    def beside(self, folder: Path) -> "Project":
        """With the photos that are found by their names in a folder."""

        def move(path: Path) -> Path:
            return folder / path if not path.is_absolute() and (folder / path).is_file() else path

        return replace(self, sessions=tuple(session.moved(move) for session in self.sessions))

    def save(self, path: Path) -> None:
        """Write it, whole or not at all. Raises ``ValueError`` for a path that cannot be written."""
        parts = Parts()
        about = {
            "format": _FORMAT,
            "model": self.model,
            "path": str(self.path) if self.path else None,
            "sessions": [session.encoded(parts) for session in self.sessions],
            "timelines": parts.timelines,
        }
        with atomic_file(path, Project.load) as partial, zipfile.ZipFile(partial, "w") as file:
            file.writestr(_ABOUT, json.dumps(about), zipfile.ZIP_DEFLATED)
            # A copy each, as safetensors refuses tensors that share memory.
            file.writestr(_TENSORS, save({str(number): one.clone() for number, one in enumerate(parts.tensors)}))
            for number, photo in enumerate(parts.photos):
                file.writestr(_photo(number), photo)

    @classmethod
    def load(cls, path: Path) -> "Project":
        """Read it. Raises ``ValueError`` where it is no whole project."""
        with reading(path, "a project"), open_zip(path, _MAX_BYTES) as file:
            return cls._from_zip(file)

    @classmethod
    def _from_zip(cls, file: zipfile.ZipFile) -> "Project":
        about = typed(_About, parse_json(file.read(_ABOUT)), name="project")
        tensors = load(file.read(_TENSORS))
        count = sum(name.startswith("photos/") for name in file.namelist())
        photos = [file.read(_photo(number)) for number in range(count)]
        parts = Parts([tensors[str(number)] for number in range(len(tensors))], photos, about.timelines)
        return cls(about.model, tuple(SavedSession.decoded(one, parts) for one in about.sessions), about.path)


class _About(NamedTuple):
    """The JSON of a project."""

    format: Literal["codenerf-project-1"]
    model: str
    sessions: list
    timelines: list
    path: Path | None = None


def is_project(path: Path) -> bool:
    """Whether a file is a project, by its name."""
    return path.suffix.lower() == SUFFIX


def _photo(number: int) -> str:
    return f"photos/{number}.png"
