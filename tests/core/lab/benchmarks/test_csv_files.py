from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import pytest

from core.lab.benchmarks.csv_files import from_row, read_csv, to_row, write_csv
from core.lab.evaluation.statistics import Mean


class Point(NamedTuple):
    x: float
    y: int


@dataclass(frozen=True)
class Record:
    name: str
    right: bool
    mean: Mean
    margin: float | None
    curve: tuple[Point, ...]
    pair: tuple[int, str]


RECORDS = (
    Record("a, b", True, Mean(0.1 + 0.2, -1e-300, 1 / 3), None, (Point(0.5, 1), Point(float("inf"), 2)), (3, "x")),
    Record('say "c"', False, Mean(0.0, 0.0, 0.0), 1e-9, (), (4, "")),
)


def test_what_is_read_is_what_was_written(tmp_path: Path) -> None:
    write_csv(tmp_path / "r.csv", [{"machine": "m"} | to_row(record) for record in RECORDS])
    rows = read_csv(tmp_path / "r.csv")
    assert tuple(from_row(Record, row) for row in rows) == RECORDS
    assert {row["machine"] for row in rows} == {"m"}
    assert "curve.1.x" in rows[0]


def test_an_optional_column_that_an_older_file_lacks_is_none() -> None:
    row = to_row(RECORDS[0])
    del row["margin"]
    assert from_row(Record, row) == RECORDS[0]


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").write_text("name\n")
    with pytest.raises(ValueError, match=r"empty.csv: no measurements"):
        read_csv(tmp_path / "empty.csv")
    with pytest.raises(ValueError, match="not a row of Record: column 'right' is missing"):
        from_row(Record, {"name": "a"})
