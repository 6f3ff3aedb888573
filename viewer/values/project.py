"""A project: one file with all that was made, with every model; a zip of JSON, tensors and photos."""

import json
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

from safetensors import SafetensorError
from safetensors.torch import load, save

from core.files import atomic_file
from viewer.values.encoding import Parts
from viewer.values.saved_session import UNREADABLE, SavedSession

SUFFIX = ".codenerf"
_FORMAT = "codenerf-project-1"
_ABOUT, _TENSORS = "project.json", "tensors.safetensors"
_MAX_BYTES = 1 << 30
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
            "steps": sum(len(one.history.past) + len(one.history.future) for one in self.sessions),
            "objects": sum(len({each.name for each in one.objects} - {*one.removed}) for one in self.sessions),
            "photos under way": sum(len(one.pending) for one in self.sessions),
        }
        return ", ".join(f"{count} {what}" for what, count in counts.items() if count)

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
        with atomic_file(path) as partial, zipfile.ZipFile(partial, "w") as file:
            file.writestr(_ABOUT, json.dumps(about), zipfile.ZIP_DEFLATED)
            # A copy each, as safetensors refuses tensors that share memory.
            file.writestr(_TENSORS, save({str(number): one.clone() for number, one in enumerate(parts.tensors)}))
            for number, photo in enumerate(parts.photos):
                file.writestr(_photo(number), photo)

    @classmethod
    def load(cls, path: Path) -> "Project":
        """Read it. Raises ``ValueError`` where it is no whole project."""
        try:
            with zipfile.ZipFile(path) as file:
                return cls._from_zip(file)
        except OSError as error:
            raise ValueError(f"cannot read the project {path.name}: {error.strerror or error}") from None
        except (*UNREADABLE, RuntimeError, zipfile.BadZipFile, zlib.error, SafetensorError) as error:
            raise ValueError(f"{path.name} is not a whole project ({error})") from None

    @classmethod
    def _from_zip(cls, file: zipfile.ZipFile) -> "Project":
        if sum(member.file_size for member in file.infolist()) > _MAX_BYTES:
            raise ValueError("it is too large")
        about = json.loads(file.read(_ABOUT))
        if about["format"] != _FORMAT:
            raise ValueError(f"its format is {about['format']!r}")
        tensors = load(file.read(_TENSORS))
        count = sum(name.startswith("photos/") for name in file.namelist())
        photos = [file.read(_photo(number)) for number in range(count)]
        parts = Parts([tensors[str(number)] for number in range(len(tensors))], photos, about["timelines"])
        sessions = tuple(SavedSession.decoded(one, parts) for one in about["sessions"])
        return cls(str(about["model"]), sessions, Path(about["path"]) if about.get("path") else None)


def is_project(path: Path) -> bool:
    """Whether a file is a project, by its name."""
    return path.suffix.lower() == SUFFIX


def _photo(number: int) -> str:
    return f"photos/{number}.png"
