import subprocess
from pathlib import Path

import pytest

from core.lab.benchmarks.results import conditions, describe_code


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
