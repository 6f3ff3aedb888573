from pathlib import Path

import pytest

from core.files import atomic_file, atomic_folder


def test_a_file_appears_whole_or_not_at_all(tmp_path: Path):
    path = tmp_path / "a.txt"
    with pytest.raises(KeyError), atomic_file(path) as partial:
        partial.write_text("half")
        raise KeyError
    assert list(tmp_path.iterdir()) == []
    with atomic_file(path) as partial:
        partial.write_text("whole")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["whole"]


def test_a_folder_is_replaced_on_demand_only_and_by_a_whole_one(tmp_path: Path):
    path = tmp_path / "a"
    with atomic_folder(path) as partial:
        (partial / "old").touch()
    with pytest.raises(ValueError, match="there already"), atomic_folder(path):
        pass
    with pytest.raises(KeyError), atomic_folder(path, replace=True):
        raise KeyError
    assert [file.name for file in path.iterdir()] == ["old"]
    with atomic_folder(path, replace=True) as partial:
        (partial / "new").touch()
    assert [file.name for file in path.iterdir()] == ["new"]
    assert [file.name for file in tmp_path.iterdir()] == ["a"]
