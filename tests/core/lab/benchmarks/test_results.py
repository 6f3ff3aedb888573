import math
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import pandas as pd
import pytest

from core.lab.benchmarks.results import append_rows, conditions, describe_code, frame_of, read_frame
from core.lab.evaluation.protocol import Mean


class Point(NamedTuple):
    x: float
    y: int


@dataclass(frozen=True)
class Record:
    name: str
    right: bool
    mean: Mean
    margin: float | None
    last: Point


RECORDS = (
    Record("0000", True, Mean(0.1 + 0.2, -1e-300, 1 / 3), None, Point(float("inf"), 2)),
    Record('say "c", NA', False, Mean(0.0, 0.0, math.nan), 1e-9, Point(-1.0, 1)),
)


def test_rows_are_read_as_written(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    for record in RECORDS:
        append_rows(path, {"commit": "1e5", "processor": "m"}, [record])
    columns = "commit,processor,name,right,mean.mean,mean.low,mean.high,margin,last.x,last.y"
    assert path.read_text().splitlines()[0] == columns
    frame = read_frame(path, ["name"])
    expected = frame_of(RECORDS, {"commit": "1e5", "processor": "m"})
    pd.testing.assert_frame_equal(frame, expected, check_exact=True, check_dtype=False)


def test_empty_and_foreign_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").write_text("name\n")
    with pytest.raises(ValueError, match=r"empty.csv: no measurements"):
        read_frame(tmp_path / "empty.csv")
    path = tmp_path / "other.csv"
    append_rows(path, {"machine": "m"}, [Point(1.0, 2)])
    with pytest.raises(ValueError, match=r"other.csv: column name is missing"):
        read_frame(path, ["name"])
    path.write_text('a,b\n1,2\n"')
    with pytest.raises(ValueError, match=r"other.csv: "):
        read_frame(path)


def git(folder: Path, *words: str) -> str:
    settings = "-c", "user.name=a", "-c", "user.email=a@b"
    return subprocess.run(("git", *settings, *words), cwd=folder, capture_output=True, text=True, check=True).stdout


def test_documents_do_not_change_the_code_and_changes_are_marked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert describe_code(tmp_path) == "unknown"
    git(tmp_path, "init")
    (tmp_path / "core").mkdir()
    (tmp_path / "core/a.py").write_text("a")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-m", "code")
    first = describe_code(tmp_path)
    (tmp_path / "README.md").write_text("b")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-m", "document")
    assert describe_code(tmp_path) == first != "unknown"
    (tmp_path / "core/a.py").write_text("c")
    assert describe_code(tmp_path) == f"{first}+"


def test_every_row_says_code_processor_and_date():
    assert set(conditions()) == {"commit", "processor", "date"}
