"""Measurements as CSV files and frames: a row per trial, a column per number, and the code and machine that measured.

Columns of nested values contain a dot (``others.psnr``); None is an empty cell. Floats are written in full.
"""

import platform
import subprocess
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from datetime import date
from pathlib import Path
from typing import Any, get_type_hints

import pandas as pd
import torch

from core.runtime.precision import matmul_dtype

_ROOT = Path(__file__).resolve().parents[3]
_MEASURED = ("core", "assets/models", "assets/networks", "assets/benchmark")  # files that decide the results
_TEXTS = ("category", "name", "case", "method", "outcome", "commit")  # never read as numbers


def frame_of(rows: Iterable[object], conditions: Mapping[str, str] | None = None) -> pd.DataFrame:
    """Return a frame of rows, dataclasses of one type, with the conditions common to all as first columns."""
    return pd.DataFrame([{**(conditions or {}), **dict(_cells(row, ""))} for row in rows])


def write_frame(path: Path, frame: pd.DataFrame) -> None:
    """Write a frame, replacing an earlier file."""
    frame.to_csv(path, index=False, lineterminator="\n")


def append_rows(path: Path, conditions: Mapping[str, str], rows: Iterable[object]) -> None:
    """Append rows to a CSV file in one write; a new one gets a header."""
    with path.open("a", newline="") as file:
        file.write(frame_of(rows, conditions).to_csv(header=not file.tell(), index=False, lineterminator="\n"))


def read_frame(path: Path, columns: Sequence[str] = ()) -> pd.DataFrame:
    """Read a CSV file. Raises ``ValueError`` naming it if it has no rows or lacks a column."""
    options = {"keep_default_na": False, "na_values": ["", "nan"]}
    try:
        frame = pd.read_csv(path, dtype=dict.fromkeys(_TEXTS, str), **options)
    except pd.errors.ParserError as error:
        raise ValueError(f"{path}: {error}") from error
    if frame.empty:
        raise ValueError(f"{path}: no measurements in it")
    for name in columns:
        if name not in frame:
            raise ValueError(f"{path}: column {name} is missing")
    return frame.fillna({name: "" for name in _TEXTS if name in frame})


def _cells(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield names of columns and cells of a value."""
    if not (is_dataclass(value) or hasattr(value, "_fields")):
        yield name, value
        return
    for field in get_type_hints(type(value)):
        yield from _cells(getattr(value, field), f"{name}.{field}".removeprefix("."))


def describe_code(root: Path = _ROOT) -> str:
    """Return the last commit of the files that decide the results, with + for changes since; "unknown" without git.

    Commits of documents leave it as it is, so measurements can be resumed after them.
    """
    try:
        commit = _git(root, "log", "-1", "--format=%h", "--", *_MEASURED)
        changed = _git(root, "status", "--porcelain", "--untracked-files=no", "--", *_MEASURED)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return f"{commit}{'+' if changed else ''}"


def conditions() -> dict[str, str]:
    """Return the columns of each measurement's origin: the code, the kind of processor with torch, and the day."""
    dtype = str(matmul_dtype("cpu")).removeprefix("torch.")
    kind = f"{platform.machine()} {torch.backends.cpu.get_cpu_capability()}"
    processor = f"{kind}, {dtype}, torch {torch.__version__}"
    return {"commit": describe_code(), "processor": processor, "date": date.today().isoformat()}


def _git(root: Path, *words: str) -> str:
    return subprocess.run(("git", *words), cwd=root, capture_output=True, text=True, check=True).stdout.strip()
