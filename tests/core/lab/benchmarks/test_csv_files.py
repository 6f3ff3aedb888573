from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import pytest

from core.lab.benchmarks.csv_files import Results, read_records, read_results, write_results
from core.lab.evaluation.statistics import Mean


class Point(NamedTuple):
    x: float
    y: int


class NewerPoint(NamedTuple):
    x: float
    y: int
    z: Mean | None = None


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
    Record('say "c"', False, Mean(0.0, 0.0, 0.0), 1e-9, (Point(0.0, 0), Point(-1.0, 1)), (4, "")),
)


def test_results_are_read_as_written_and_older_files_lack_columns(tmp_path: Path) -> None:
    results = Results({"machine": "m"}, RECORDS)
    for _ in range(2):  # the second file replaces the first
        write_results(tmp_path / "r.csv", results)
        assert read_results(tmp_path / "r.csv", Record) == results
    assert read_records(tmp_path / "r.csv", Record, {"machine": "m"}) == RECORDS
    assert read_records(tmp_path / "none.csv", Record) == ()
    write_results(tmp_path / "r.csv", Results({}, (Point(1.0, 2),)))
    assert read_results(tmp_path / "r.csv", NewerPoint).rows == (NewerPoint(1.0, 2),)


def test_empty_and_foreign_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").write_text("name\n")
    with pytest.raises(ValueError, match=r"empty.csv: no measurements"):
        read_results(tmp_path / "empty.csv", Record)
    write_results(tmp_path / "other.csv", Results({"machine": "m"}, (Point(1.0, 2),)))
    with pytest.raises(ValueError, match=r"other.csv: no rows of Record: column 'name' is missing"):
        read_results(tmp_path / "other.csv", Record)
    with pytest.raises(ValueError, match=r"other.csv: machine 'm', and now 'n'; measure into another folder"):
        read_records(tmp_path / "other.csv", Point, {"machine": "n"})
