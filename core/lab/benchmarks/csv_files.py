"""Results as CSV: a line per frozen value, a column per number.

Nested values become columns with a dot (``held_out.low``), tuples columns with an index (``rotation_curve.3``), None an
empty cell. Floats are written in full, so that reading gives back what was measured.
"""

import csv
import io
import types
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar, get_args, get_origin, get_type_hints

_Record = TypeVar("_Record")
Row = Mapping[str, str]


@dataclass(frozen=True)
class Results(Generic[_Record]):
    """Everything that one run measured: a CSV file."""

    about: Row  # columns that are the same in all rows: the machine, for one
    rows: tuple[_Record, ...]


def write_results(path: Path, found: Results[Any]) -> None:
    """Writes a line per row."""
    write_csv(path, [{**found.about, **to_row(row)} for row in found.rows])


def read_results(path: Path, kind: type[_Record]) -> Results[_Record]:
    """Reads what :func:`write_results` or :func:`append_record` wrote. Raises ``ValueError`` where it is none."""
    rows, fields = read_csv(path), _hints(kind)
    about = {name: text for name, text in rows[0].items() if name.partition(".")[0] not in fields}
    return Results(about, tuple(from_row(kind, row) for row in rows))


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    """Writes rows; a column that a row lacks is an empty cell."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def append_record(path: Path, about: Row, record: object) -> None:
    """Adds a record to a file, which it begins where there is none, and what all records of a run have in common.

    A row is one write, so several processes may add to one file.
    """
    row = {**about, **to_row(record)}
    with path.open("a", newline="") as file:
        text = io.StringIO()
        writer = csv.DictWriter(text, list(row), lineterminator="\n")
        if not file.tell():
            writer.writeheader()
        writer.writerow(row)
        file.write(text.getvalue())


def read_records(path: Path, kind: type[_Record], about: Row | None = None) -> tuple[_Record, ...]:
    """The rows that a run measured so far; none where there is no file yet.

    Raises ``ValueError`` where the rows are of something else than ``about``: what is measured goes to another folder.
    """
    rows = read_csv(path) if path.exists() else []
    for name, text in (about or {}).items():
        for row in rows:
            if row.get(name) != text:
                raise ValueError(f"{path}: {name} {row.get(name)!r}, and now {text!r}; measure into another folder")
    return tuple(from_row(kind, row) for row in rows)


def read_csv(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file. Raises ``ValueError`` naming it where it holds none."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    if not rows:
        raise ValueError(f"{path}: no measurements in it")
    return rows


def to_row(value: object) -> dict[str, str]:
    """A dataclass or a named tuple as columns.

    Example:
        >>> from core.lab.evaluation.statistics import Mean
        >>> to_row(Mean(0.5, 0.0, 1.0))
        {'mean': '0.5', 'low': '0.0', 'high': '1.0'}
    """
    return {name.removeprefix("."): text for name, text in _cells(value, "")}


def from_row(kind: type[_Record], row: Row) -> _Record:
    """Reads what :func:`to_row` wrote. Raises ``ValueError`` where a column is missing or does not parse."""
    try:
        return _parse(kind, row, "")
    except (KeyError, TypeError) as error:
        raise ValueError(f"not a row of {kind.__name__}: column {error} is missing") from error


def _cells(value: Any, name: str) -> list[tuple[str, str]]:
    if _has_fields(type(value)):
        parts = [(field, getattr(value, field)) for field in _hints(type(value))]
    elif isinstance(value, tuple):
        parts = [(str(index), part) for index, part in enumerate(value)]
    else:
        return [(name, "" if value is None else str(value))]
    return [cell for part, inner in parts for cell in _cells(inner, f"{name}.{part}")]


def _parse(kind: Any, row: Row, name: str) -> Any:
    if isinstance(kind, types.UnionType):
        (some,) = (option for option in get_args(kind) if option is not types.NoneType)
        known = any(text for column, text in row.items() if f"{column}.".startswith(f"{name}."))
        return _parse(some, row, name) if known else None
    if _has_fields(kind):
        return kind(**{field: _parse(hint, row, _join(name, field)) for field, hint in _hints(kind).items()})
    if get_origin(kind) is tuple:
        kinds = get_args(kind)
        return tuple(_parse(one, row, f"{name}.{index}") for index, one in enumerate(_items(kinds, row, name)))
    return row[name] == "True" if kind is bool else kind(row[name])


def _items(kinds: tuple[Any, ...], row: Row, name: str) -> list[Any]:
    """The types of a tuple's items; of ``tuple[x, ...]`` as many as the row has."""
    if kinds[-1] is not Ellipsis:
        return list(kinds)
    count = 0
    while any(row[column] for column in row if f"{column}.".startswith(f"{name}.{count}.")):
        count += 1
    return [kinds[0]] * count


def _join(name: str, field: str) -> str:
    return f"{name}.{field}" if name else field


def _has_fields(kind: Any) -> bool:
    return is_dataclass(kind) or hasattr(kind, "_fields")


def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)
