"""Damage projects, scenes, images and models for a long time: ``python -m tests.fuzz SECONDS [SEED]``.

Each reader gives a value or one ``ValueError`` of one short line that names a file, within 20 s of processor time
and 0.5 GB of memory. What breaks this is kept in the folder of temporary files and ends the run with status 1.
"""

import io
import json
import random
import resource
import signal
import sys
import tempfile
import time
import warnings
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from core.models.library import load_model
from core.models.open_models import OpenModels
from viewer.values.project import Project  # before the tests' checks of shapes, which the program has not

from tests.core.test_fuzz import READERS, corrupted  # isort: skip

_FILES = Path(__file__).parent / "files"
_MOST_SECONDS, _MOST_MEMORY = 20.0, 500_000  # of the processor; kB beside the program's own
_VALUES = (None, True, -1, 0, 1e308, 10**400, float("nan"), float("inf"), "", "a" * 9999, [], {}, [[]] * 999, "../a")


class _Hang(BaseException):
    """Not to be caught by a reader."""


def _hang(*_: object) -> None:
    raise _Hang


def _mutated_json(value: Any, numbers: random.Random) -> Any:
    """JSON with one value replaced, removed or doubled."""
    if not isinstance(value, dict | list) or not value or numbers.random() < 0.05:
        return numbers.choice(_VALUES)
    if isinstance(value, list) and numbers.random() < 0.1:
        return value * numbers.choice((0, 2, 50))
    key = numbers.choice(list(value)) if isinstance(value, dict) else numbers.randrange(len(value))
    found = value.copy()
    if numbers.random() < 0.05:
        del found[key]
    else:
        found[key] = _mutated_json(value[key], numbers)
    return found


def _mutated(content: bytes, numbers: random.Random) -> bytes:
    """A file with some bytes, one value of its JSON, or one member of its zip changed."""
    if content[:2] == b"PK" and numbers.random() < 0.9:
        with zipfile.ZipFile(io.BytesIO(content)) as file:
            members = {name: file.read(name) for name in file.namelist()}
        name = numbers.choice([*members, *(name for name in members if name.endswith(".json"))])
        members[name] = _mutated(members[name], numbers)
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", numbers.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as file:
            for name, member in members.items():
                file.writestr(name, member)
        return packed.getvalue()
    if content[:1] == b"{" and numbers.random() < 0.8:
        return json.dumps(_mutated_json(json.loads(content), numbers)).encode()
    return corrupted(content, numbers)


def _copied(source: Path, path: Path) -> None:
    path.write_bytes(source.read_bytes())


def _readers() -> dict[str, tuple[Callable[[Path], object], Callable[[Path], object]]]:
    """What writes a whole file, and what reads it, by kind."""
    models = OpenModels(load_model)
    for name in ("chairs", "cars"):
        models.open(name)
    projects = {
        f"project of {path.parent.name}": (partial(_copied, path), partial(Project.load, models=models))
        for path in _FILES.glob("*/project.codenerf")
    }
    return READERS | projects


def _failure(read: Callable[[Path], object], path: Path) -> str:
    """What is wrong with reading a file; empty where nothing is."""
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    signal.setitimer(signal.ITIMER_PROF, _MOST_SECONDS)
    try:
        read(path)
    except ValueError as error:
        text = str(error)
        if "\n" in text or len(text) > max(200, len(str(path)) + 100) or "/" not in text:
            return f"says {text!r}"
    except (_Hang, Exception) as error:
        return f"raises {error!r} after {time.process_time() - began:.1f} s"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return f"takes {more / 1000:.0f} MB" if more > _MOST_MEMORY else ""


def main(seconds: float, seed: int) -> int:
    """Damage files for so long; return how many failed."""
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGPROF, _hang)
    numbers, failed, tried, readers = random.Random(seed), 0, 0, _readers()
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    while time.process_time() < seconds:
        for name, (write, read) in readers.items():
            place = Path(tempfile.mkdtemp(dir=folder))
            path = place / "whole.bin"
            write(path)
            damaged = _mutated(path.read_bytes(), numbers)
            path.write_bytes(damaged)
            tried += 1
            if wrong := _failure(read, path):
                failed += 1
                (folder / f"{name} {tried}").write_bytes(damaged)
                print(f"{name} {tried}: {wrong}", flush=True)
            for left in sorted(place.rglob("*"), reverse=True):
                left.rmdir() if left.is_dir() else left.unlink()
            place.rmdir()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
    print(f"{tried} files in {time.process_time():.0f} s, {failed} failures, {peak:.0f} MB; in {folder}")
    return failed


if __name__ == "__main__":
    sys.exit(min(1, main(float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)))
