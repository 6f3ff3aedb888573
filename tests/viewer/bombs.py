"""Small files that would take gigabytes, made of a whole project of whatever format.

``python -m tests.viewer.bombs project.codenerf FOLDER`` writes them all.
"""

import io
import json
import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from PIL import Image

Members = dict[str, bytes]

_ABOUT = "project.json"


def _each(value: Any) -> Iterator[dict]:
    """All objects in JSON, the outer ones first."""
    if isinstance(value, dict):
        yield value
    for part in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _each(part)


def _changed(members: Members, change: Callable[[dict], object]) -> Members:
    about = json.loads(members[_ABOUT])
    for one in _each(about):
        change(one)
    return members | {_ABOUT: json.dumps(about).encode()}


def _png(side: int) -> bytes:
    file = io.BytesIO()
    Image.new("L", (side, side), 255).save(file, "PNG")
    return file.getvalue()


def _enlarge_cameras(one: dict) -> None:
    if {"width", "height", "focal"} <= one.keys():
        one.update(width=16_000, height=16_000)


def _repeat_photos(one: dict) -> None:
    if one.get("photos") and one.get("sources"):
        one.update(photos=one["photos"] * 99, sources=one["sources"] * 99)


BOMBS: dict[str, tuple[Callable[[Members], Members], int, str]] = {
    "photo": (lambda whole: whole | {"photos/0.png": _png(13_000)}, zipfile.ZIP_DEFLATED, "the image is too large"),
    "photos": (
        lambda whole: _changed(whole | {"photos/0.png": _png(1_900)}, _repeat_photos),
        zipfile.ZIP_DEFLATED,
        "the image is too large",
    ),
    "cameras": (
        lambda whole: _changed(whole, _enlarge_cameras),
        zipfile.ZIP_DEFLATED,
        "the cameras have another size than the photos",
    ),
    "json": (
        lambda whole: whole | {_ABOUT: whole[_ABOUT][:-1] + b', "more": "' + b"a" * 17_000_000 + b'"}'},
        zipfile.ZIP_DEFLATED,
        "JSON has at most 16 MB",
    ),
    "nesting": (
        lambda whole: whole | {_ABOUT: whole[_ABOUT][:-1] + b', "more": ' + b"[" * 9_999 + b"]" * 9_999 + b"}"},
        zipfile.ZIP_DEFLATED,
        "nested too deeply",
    ),
    "deflate": (lambda whole: whole | {"more": bytes(120_000_000)}, zipfile.ZIP_DEFLATED, "it unpacks to more than"),
    "lzma": (lambda whole: whole | {"more": bytes(120_000_000)}, zipfile.ZIP_LZMA, "it unpacks to more than"),
    "bzip2": (lambda whole: whole | {"more": bytes(120_000_000)}, zipfile.ZIP_BZIP2, "it unpacks to more than"),
    "members": (
        lambda whole: whole | {f"photos/a{number}": b"" for number in range(10_001)},
        zipfile.ZIP_STORED,
        "it unpacks to more than",
    ),
}
"""By what is too large: how it is made, how it is compressed, and what refuses it."""


def write_bomb(name: str, whole: Path, path: Path) -> None:
    """Write one of :data:`BOMBS`, made of a whole project."""
    make, compression, _ = BOMBS[name]
    with zipfile.ZipFile(whole) as file:
        members = {name: file.read(name) for name in file.namelist()}
    with zipfile.ZipFile(path, "w", compression) as file:
        for member, content in make(members).items():
            file.writestr(member, content)


if __name__ == "__main__":
    for one in BOMBS:
        write_bomb(one, Path(sys.argv[1]), Path(sys.argv[2]) / f"{one}.codenerf")
