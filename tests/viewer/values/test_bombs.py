"""Small files that would take gigabytes, made of a whole project."""

import io
import json
import re
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from tests.viewer.driver import finish
from viewer.session import Session

Members = dict[str, bytes]

_ABOUT = "project.json"


def _each(value: Any) -> Iterator[dict]:
    """All objects in JSON, the outer ones first."""
    if isinstance(value, dict):
        yield value
    for item in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _each(item)


def _changed(members: Members, change: Callable[[dict], object]) -> Members:
    record = json.loads(members[_ABOUT])
    for item in _each(record):
        change(item)
    return members | {_ABOUT: json.dumps(record).encode()}


def _png(side: int) -> bytes:
    file = io.BytesIO()
    Image.new("L", (side, side), 255).save(file, "PNG")
    return file.getvalue()


def _enlarge_cameras(item: dict) -> None:
    if {"width", "height", "focal"} <= item.keys():
        item.update(width=16_000, height=16_000)


def _repeat_photos(item: dict) -> None:
    if item.get("photos") and item.get("sources"):
        item.update(photos=item["photos"] * 99, sources=item["sources"] * 99)


BOMBS: dict[str, tuple[Callable[[Members], Members], int, str]] = {
    "photo": (lambda members: members | {"photos/0.png": _png(13_000)}, zipfile.ZIP_DEFLATED, "the image is too large"),
    "photos": (
        lambda members: _changed(members | {"photos/0.png": _png(1_900)}, _repeat_photos),
        zipfile.ZIP_DEFLATED,
        "the image is too large",
    ),
    "cameras": (
        lambda members: _changed(members, _enlarge_cameras),
        zipfile.ZIP_DEFLATED,
        "the cameras have another size than the photos",
    ),
    "json": (
        lambda members: members | {_ABOUT: members[_ABOUT][:-1] + b', "more": "' + b"a" * 17_000_000 + b'"}'},
        zipfile.ZIP_DEFLATED,
        "JSON has at most 16 MB",
    ),
    "nesting": (
        lambda members: members | {_ABOUT: members[_ABOUT][:-1] + b', "more": ' + b"[" * 9_999 + b"]" * 9_999 + b"}"},
        zipfile.ZIP_DEFLATED,
        "nested too deeply",
    ),
    "deflate": (
        lambda members: members | {"more": bytes(120_000_000)},
        zipfile.ZIP_DEFLATED,
        "it unpacks to more than",
    ),
    "lzma": (lambda members: members | {"more": bytes(120_000_000)}, zipfile.ZIP_LZMA, "it unpacks to more than"),
    "bzip2": (lambda members: members | {"more": bytes(120_000_000)}, zipfile.ZIP_BZIP2, "it unpacks to more than"),
    "members": (
        lambda members: members | {f"photos/a{number}": b"" for number in range(10_001)},
        zipfile.ZIP_STORED,
        "it unpacks to more than",
    ),
}
"""By what is too large: how it is made, how it is compressed, and what refuses it."""


def write_bomb(name: str, project: Path, path: Path) -> None:
    """Write one of :data:`BOMBS`, made of a whole project."""
    make, compression, _ = BOMBS[name]
    with zipfile.ZipFile(project) as file:
        members = {name: file.read(name) for name in file.namelist()}
    with zipfile.ZipFile(path, "w", compression) as file:
        for member, content in make(members).items():
            file.writestr(member, content)


_MOST = 500  # MB more than before the file is read

_READ = """
import resource, sys
from pathlib import Path
from core.models.open_models import OpenModels
from tests.conftest import random_model
from viewer.values.project import Project
models = OpenModels(lambda name: random_model())
def megabytes():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // (1024 if sys.platform == "linux" else 1024**2)
Project.load(Path(sys.argv[1]), models)
before = megabytes()
for path in map(Path, sys.argv[2:]):
    try:
        (original,) = Project.load(path, models).originals
        print(f"{path.stem}: {original.name}: {original.reasons}")
    except ValueError as error:
        print(f"{path.stem}: {error}")
print(megabytes() - before)
"""


@pytest.fixture
def project(session: Session, photo: Path, tmp_path: Path) -> Path:
    """A project with a fit."""
    session.fitting.start(photo)
    finish(session, lambda: not session.fitting.running)
    session.project().save(tmp_path / "project.codenerf", session.models)
    return tmp_path / "project.codenerf"


@pytest.mark.skipif(sys.platform == "win32", reason="nobody counts memory there")
def test_small_files_that_would_take_gigabytes_are_refused_by_their_bounds(project: Path, tmp_path: Path) -> None:
    paths = [tmp_path / f"{name}.codenerf" for name in BOMBS]
    for name, path in zip(BOMBS, paths, strict=True):
        write_bomb(name, project, path)
        assert path.stat().st_size < 1_500_000
    words = [sys.executable, "-c", _READ, project, *paths]
    done = subprocess.run(words, cwd=Path(__file__).parents[3], capture_output=True, text=True, check=True)
    *lines, megabytes = done.stdout.splitlines()
    for (name, (_, _, said)), line in zip(BOMBS.items(), lines, strict=True):
        assert re.match(rf"{name}: .*{name}\.codenerf: .*{said}", line)
    assert int(megabytes) < _MOST
