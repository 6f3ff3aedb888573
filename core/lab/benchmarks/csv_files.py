"""Benchmark results as CSV: a row per dataclass, a column per number.

Columns of nested values contain a dot (``held_out.low``), those of tuples an index (``rotation_curve.3``); None is an
empty cell. Floats are written in full, so reading returns the exact values.
"""

import csv
import io
import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from itertools import count, takewhile
from pathlib import Path
from typing import Any, Generic, TypeVar, get_args, get_origin, get_type_hints

_Record = TypeVar("_Record")
Row = Mapping[str, str]


@dataclass(frozen=True)
class Results(Generic[_Record]):
    """The measurements of one run: a CSV file."""

    common: Row  # columns that are the same in all rows, such as the machine
    rows: tuple[_Record, ...]


def write_results(path: Path, results: Results[Any]) -> None:
    """Write all rows, replacing an earlier file."""
    path.unlink(missing_ok=True)
    for row in results.rows:
        append_record(path, results.common, row)


def append_record(path: Path, common: Row, record: object) -> None:
    """Append a row: the columns common to a run, then those of the record.

    A new file gets a header. A row is one write, so several processes may append to one file.
    """
    row = {**common, **{name.removeprefix("."): text for name, text in _cells(record, "")}}
    with path.open("a", newline="") as file:
        text = io.StringIO()
        writer = csv.DictWriter(text, list(row), lineterminator="\n")
        if not file.tell():
            writer.writeheader()
        writer.writerow(row)
        file.write(text.getvalue())


def read_results(path: Path, kind: type[_Record]) -> Results[_Record]:
    """Read all rows of a file. Raises ``ValueError`` naming it if they are not of this kind."""
    rows = read_csv(path)
    fields = get_type_hints(kind)
    common = {name: text for name, text in rows[0].items() if name.partition(".")[0] not in fields}
    try:
        return Results(common, tuple(_parse(kind, row, "") for row in rows))
    except (KeyError, TypeError) as error:
        raise ValueError(f"{path}: no rows of {kind.__name__}: column {error} is missing") from error


def read_records(path: Path, kind: type[_Record], common: Row | None = None) -> tuple[_Record, ...]:
    """Read the rows of an interrupted run; none if there is no file.

    Raises ``ValueError`` if their common columns differ from ``common``.
    """
    if not path.exists():
        return ()
    results = read_results(path, kind)
    for name, text in (common or {}).items():
        for row in read_csv(path):
            if row.get(name) != text:
                raise ValueError(f"{path}: {name} {row.get(name)!r}, and now {text!r}; measure into another folder")
    return results.rows


def read_csv(path: Path) -> list[dict[str, str]]:
    """Read the rows of a CSV file as text. Raises ``ValueError`` naming it if there are none."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    if not rows:
        raise ValueError(f"{path}: no measurements in it")
    return rows


def _cells(value: Any, name: str) -> Iterator[tuple[str, str]]:
    """Yield the columns of a value: name, beginning with a dot, and text."""
    if is_dataclass(value) or hasattr(value, "_fields"):
        fields = [(field, getattr(value, field)) for field in get_type_hints(type(value))]
    elif isinstance(value, tuple):
        fields = [(str(index), item) for index, item in enumerate(value)]
    else:
        yield name, "" if value is None else str(value)
        return
    for field, content in fields:
        yield from _cells(content, f"{name}.{field}")


def _parse(kind: Any, row: Row, name: str) -> Any:
    """Invert :func:`_cells`. Raises ``KeyError`` for a missing column."""
    if is_dataclass(kind) or hasattr(kind, "_fields"):
        return kind(**{field: _parse(hint, row, f"{name}.{field}") for field, hint in get_type_hints(kind).items()})
    if get_origin(kind) is tuple:
        kinds = get_args(kind)
        if kinds[-1] is Ellipsis:  # as many as there are columns
            columns = [f".{column}." for column in row]
            indices = takewhile(lambda index: any(column.startswith(f"{name}.{index}.") for column in columns), count())
            kinds = kinds[:1] * len(list(indices))
        return tuple(_parse(item_kind, row, f"{name}.{index}") for index, item_kind in enumerate(kinds))
    if isinstance(kind, types.UnionType):  # None in older files, which lack the columns
        (value_kind,) = (option for option in get_args(kind) if option is not types.NoneType)
        filled = any(cell for column, cell in row.items() if f".{column}.".startswith(f"{name}."))
        return _parse(value_kind, row, name) if filled else None
    text = row[name.removeprefix(".")]
    return text == "True" if kind is bool else kind(text)
