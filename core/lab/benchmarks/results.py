"""Measurements as CSV files and frames: a row per trial, a column per number.

Columns of nested values contain a dot (``held_out.low``), those of tuples an index (``rotation_curve.3``); None is an
empty cell. Floats are written in full.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, get_type_hints

import pandas as pd

_TEXTS = ("candidate", "detected", "name", "outcome", "photo")  # never read as numbers; empty rather than missing


def frame_of(rows: Iterable[object], conditions: Mapping[str, str] | None = None) -> pd.DataFrame:
    """Return a frame of rows, dataclasses of one type, with the conditions common to all as first columns."""
    return pd.DataFrame([{**(conditions or {}), **dict(_cells(row, ""))} for row in rows])


def write_frame(path: Path, frame: pd.DataFrame) -> None:
    """Write a frame, replacing an earlier file."""
    frame.to_csv(path, index=False, lineterminator="\n")


def append_row(path: Path, conditions: Mapping[str, str], row: object) -> None:
    """Append a row to a CSV file; a new one gets a header. One write, so processes may share a file."""
    with path.open("a", newline="") as file:
        file.write(frame_of([row], conditions).to_csv(header=not file.tell(), index=False, lineterminator="\n"))


def read_frame(path: Path, columns: Sequence[str] = (), conditions: Mapping[str, str] | None = None) -> pd.DataFrame:
    """Read a CSV file. Raises ``ValueError`` naming it if it has no rows, lacks a column, or has other conditions."""
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
    for name, text in (conditions or {}).items():
        for cell in frame[name].astype(str) if name in frame else ["missing"]:
            if cell != text:
                raise ValueError(f"{path}: {name} {cell!r}, and now {text!r}; measure into another folder")
    return frame.fillna({name: "" for name in _TEXTS if name in frame})


def keys_of(frame: pd.DataFrame, columns: Sequence[str]) -> set[tuple]:
    """Return the keys of all rows: their cells in these columns."""
    return set(frame[list(columns)].itertuples(index=False, name=None))


def _cells(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield names of columns and cells of a value."""
    if is_dataclass(value) or hasattr(value, "_fields"):
        fields = [(field, getattr(value, field)) for field in get_type_hints(type(value))]
    elif isinstance(value, tuple):
        fields = [(str(index), item) for index, item in enumerate(value)]
    else:
        yield name, value
        return
    for field, content in fields:
        yield from _cells(content, f"{name}.{field}".removeprefix("."))
