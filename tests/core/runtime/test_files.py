import shutil
import sys
from pathlib import Path

import pytest

from core.runtime.files import atomic_file, atomic_folder, require_writable, save_or_elsewhere


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


def test_what_cannot_be_read_back_does_not_replace_what_was_there(tmp_path: Path):
    path = tmp_path / "a.txt"
    path.write_text("before")

    def check(partial: Path) -> None:
        raise ValueError(f"no {partial.read_text()}")

    with pytest.raises(ValueError, match=r"cannot be read back.*no after"), atomic_file(path, check) as partial:
        partial.write_text("after")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["before"]


def test_a_name_as_long_as_systems_allow_is_written(tmp_path: Path):
    for path in (tmp_path / ("a" * 251 + ".txt"), tmp_path / ("a." + "b" * 250)):
        with atomic_file(path) as partial:
            partial.write_text("whole")
        require_writable(path)
        assert path.read_text() == "whole"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a folder that takes no files, also from root")
def test_a_place_that_takes_no_files_is_named_before_the_work():
    path = Path("/proc/a.txt")
    for write in (lambda: require_writable(path), lambda: atomic_file(path).__enter__()):
        with pytest.raises(ValueError, match=r"cannot write /proc/a\.txt: "):
            write()


def test_a_place_that_is_gone_at_the_end_does_not_hide_why(tmp_path: Path):
    (tmp_path / "b").mkdir()
    with (
        pytest.raises(ValueError, match=r"cannot write .*a\.txt: No such file"),
        atomic_file(tmp_path / "b/a.txt") as _,
    ):
        shutil.rmtree(tmp_path / "b")


def test_what_cannot_be_saved_is_saved_elsewhere_and_both_places_named(tmp_path: Path):
    def save(path: Path) -> None:
        if "gone" in str(path):
            raise ValueError(f"cannot write {path}: it is gone")
        path.write_text("kept")

    save_or_elsewhere(save, tmp_path / "a.txt")
    assert (tmp_path / "a.txt").read_text() == "kept"
    with pytest.raises(ValueError, match=r"cannot write gone/a\.txt: it is gone; it is in ") as error:
        save_or_elsewhere(save, Path("gone/a.txt"))
    found = Path(str(error.value).split("it is in ")[1].removesuffix(" instead"))
    assert found.read_text() == "kept"
    shutil.rmtree(found.parent)
