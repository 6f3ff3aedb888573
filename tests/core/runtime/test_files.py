import os
import random
import shutil
import signal
import stat
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from core.runtime.files import atomic_file, atomic_folder, require_writable, save_or_elsewhere, write_json

_POSIX = pytest.mark.skipif(sys.platform == "win32", reason="links and modes of POSIX")
_ROOT = Path(__file__).parents[3]


def write(path: Path, text: str) -> None:
    require_writable(path)
    with atomic_file(path) as partial:
        partial.write_text(text)


def test_a_file_appears_complete_or_not_at_all(tmp_path: Path):
    path = tmp_path / "a.txt"
    with pytest.raises(KeyError), atomic_file(path) as partial:
        partial.write_text("half")
        raise KeyError
    assert list(tmp_path.iterdir()) == []
    with atomic_file(path) as partial:
        partial.write_text("whole")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["whole"]


def test_a_folder_is_replaced_only_on_demand_and_completely(tmp_path: Path):
    path = tmp_path / "a"
    with atomic_folder(path) as partial:
        (partial / "old").touch()
    with pytest.raises(ValueError, match="exists already"), atomic_folder(path):
        pass
    with pytest.raises(KeyError), atomic_folder(path, replace=True):
        raise KeyError
    assert [file.name for file in path.iterdir()] == ["old"]
    with atomic_folder(path, replace=True) as partial:
        (partial / "new").touch()
    assert [file.name for file in path.iterdir()] == ["new"]
    assert [file.name for file in tmp_path.iterdir()] == ["a"]


def test_a_file_that_fails_its_check_does_not_replace_the_old_one(tmp_path: Path):
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
def test_an_unwritable_path_is_named_before_the_work():
    path = Path("/proc/a.txt")
    for write in (lambda: require_writable(path), lambda: atomic_file(path).__enter__()):
        with pytest.raises(ValueError, match=r"cannot write /proc/a\.txt: "):
            write()


def test_a_folder_deleted_during_the_work_is_reported(tmp_path: Path):
    (tmp_path / "b").mkdir()
    with (
        pytest.raises(ValueError, match=r"cannot write .*a\.txt: No such file"),
        atomic_file(tmp_path / "b/a.txt") as _,
    ):
        shutil.rmtree(tmp_path / "b")


def test_a_failed_save_falls_back_to_the_temporary_folder_and_names_both_paths(tmp_path: Path):
    def save(path: Path) -> None:
        if "gone" in str(path):
            raise ValueError(f"cannot write {path}: it is gone")
        path.write_text("kept")

    save_or_elsewhere(save, tmp_path / "a.txt")
    assert (tmp_path / "a.txt").read_text() == "kept"
    with pytest.raises(ValueError, match=r"cannot write gone/a\.txt: it is gone; it is in ") as error:
        save_or_elsewhere(save, Path("gone/a.txt"))
    fallback = Path(str(error.value).split("it is in ")[1].removesuffix(" instead"))
    assert fallback.read_text() == "kept"
    shutil.rmtree(fallback.parent)


@_POSIX
def test_a_link_is_followed_to_an_existing_or_new_target(tmp_path: Path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link.txt").symlink_to("middle.txt")
    (tmp_path / "middle.txt").symlink_to("there/real.txt")
    for text in ("new", "newer"):
        write(tmp_path / "link.txt", text)
        assert (tmp_path / "link.txt").is_symlink()
        assert (tmp_path / "there" / "real.txt").read_text() == text
    (tmp_path / "lost.txt").symlink_to("nowhere/real.txt")
    with pytest.raises(ValueError, match=r"cannot write .*lost\.txt: there is no folder"):
        require_writable(tmp_path / "lost.txt")


@_POSIX
def test_a_folder_behind_a_link_is_replaced_and_the_link_stays(tmp_path: Path):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    with atomic_folder(tmp_path / "link", replace=True) as partial:
        (partial / "new").touch()
    assert (tmp_path / "link").is_symlink()
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["link", "new", "real"]


@_POSIX
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664])
def test_a_file_keeps_its_mode_also_while_it_is_written(tmp_path: Path, mode: int):
    (tmp_path / "a.txt").touch()
    (tmp_path / "a.txt").chmod(mode)
    with atomic_file(tmp_path / "a.txt") as partial:
        assert stat.S_IMODE(partial.stat().st_mode) == mode
        partial.write_text("after")
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == mode


@pytest.mark.skipif(getattr(os, "geteuid", lambda: 0)() == 0, reason="nothing is protected from root")
def test_a_write_protected_file_is_refused(tmp_path: Path):
    (tmp_path / "a.txt").write_text("before")
    (tmp_path / "a.txt").chmod(0o400)
    with pytest.raises(ValueError, match=r"cannot write .*a\.txt: Permission denied"):
        write(tmp_path / "a.txt", "after")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["before"]


@_POSIX
def test_a_pipe_is_written_straight(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    read = list[str]()
    reader = threading.Thread(target=lambda: read.append((tmp_path / "pipe").read_text()))
    reader.start()
    write_json(tmp_path / "pipe", {"a": 1})
    reader.join()
    assert read == ['{\n "a": 1\n}\n']
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


_TO_STREAM = """
import sys
from pathlib import Path
from core.runtime.files import open_output, require_writable, write_json
print("before")
for name in sys.argv[1:]:
    require_writable(Path(name))
    write_json(Path(name), {})
with open_output(Path(sys.argv[1])) as lines:
    lines.write(b"a line\\n")
print("after")
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="links to descriptors of Linux")
@pytest.mark.parametrize("to_file", [True, False])
def test_paths_of_standard_output_are_appended_in_order(tmp_path: Path, to_file: bool):
    (tmp_path / "link").symlink_to("/proc/self/fd/1")
    words = [sys.executable, "-c", _TO_STREAM, tmp_path / "link", "/dev/fd/1", "/dev/stdout", "/dev/null"]
    if to_file:
        with (tmp_path / "out").open("w") as file:
            subprocess.run(words, stdout=file, check=True, cwd=_ROOT)
        output = (tmp_path / "out").read_text()
    else:
        output = subprocess.run(words, stdout=subprocess.PIPE, check=True, cwd=_ROOT, text=True).stdout
    assert output == "before\n" + 3 * "{}\n" + "a line\nafter\n"
    assert (tmp_path / "link").is_symlink()
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)


def test_the_last_of_two_writers_in_a_process_wins_completely(tmp_path: Path):
    path = tmp_path / "a.txt"
    with ExitStack() as first:
        of_first = first.enter_context(atomic_file(path))
        with of_first.open("w") as file_of_first:
            file_of_first.write("1" * 100_000)
            with atomic_file(path) as of_second:
                of_second.write_text("2" * 50_000)
            assert path.read_text() == "2" * 50_000
            file_of_first.write("1" * 100_000)
    assert path.read_text() == "1" * 200_000
    assert list(tmp_path.iterdir()) == [path]


_WRITER = """
import sys
from pathlib import Path
from core.runtime.files import atomic_file
path, text = Path(sys.argv[1]), sys.argv[2] * 1_000_000
print("begins", flush=True)
while True:
    with atomic_file(path) as partial:
        partial.write_text(text)
"""


@_POSIX
def test_two_writers_killed_at_any_moment_leave_a_complete_file(tmp_path: Path):
    path = tmp_path / "a.txt"
    numbers = random.Random(0)
    path.write_text("0" * 1_000_000)
    for _ in range(25):
        words = [sys.executable, "-c", _WRITER, path]
        writers = [subprocess.Popen([*words, text], stdout=subprocess.PIPE, cwd=_ROOT) for text in "ab"]
        for writer in writers:
            writer.stdout.readline()
        for writer in writers:
            time.sleep(numbers.uniform(0, 0.02))
            writer.kill()
            writer.communicate()
        text = path.read_text()
        assert len(text) == 1_000_000
        assert len(set(text)) == 1


_SLOW_WRITER = """
import sys, time
from pathlib import Path
from core.runtime.files import atomic_file
from core.runtime.signals import on_signals
on_signals()
with atomic_file(Path(sys.argv[1])) as partial:
    partial.write_text("half")
    print("begun", flush=True)
    time.sleep(60)
"""


@_POSIX
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_removes_the_unfinished_file(tmp_path: Path, number: signal.Signals):
    words = [sys.executable, "-c", _SLOW_WRITER, tmp_path / "a.txt"]
    # A shell that runs the tests in the background lets them ignore interrupts.
    quiet = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "cwd": _ROOT}
    with subprocess.Popen(words, preexec_fn=lambda: signal.signal(number, signal.SIG_DFL), **quiet) as writer:
        writer.stdout.readline()
        assert len(list(tmp_path.iterdir())) == 1
        writer.send_signal(number)
    assert list(tmp_path.iterdir()) == []
    assert writer.returncode in (128 + number, -number)
