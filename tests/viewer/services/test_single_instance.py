import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from viewer.services.single_instance import SingleInstance, Start, begin


@pytest.fixture
def window(tmp_path: Path) -> Iterator[SingleInstance]:
    """The first of its folder."""
    first = begin(tmp_path / "home", Start())
    assert first is not None
    with closing(first):
        yield first


def handed_over(window: SingleInstance, folder: Path, *starts: Start) -> list[Start]:
    """The starts that a window takes while others begin, one after the other; all of them end."""
    taken = list[Start]()
    ended = list[SingleInstance | None]()
    second = threading.Thread(target=lambda: ended.extend(begin(folder, start) for start in starts))
    second.start()
    while second.is_alive():
        taken += window.starts()
        time.sleep(0.01)
    assert ended == [None] * len(starts)
    return taken


def test_a_second_start_is_handed_over(window: SingleInstance, tmp_path: Path) -> None:
    starts = Start("/photos/chaise à l'été.png", "cars"), Start()
    assert handed_over(window, tmp_path / "home", *starts) == [*starts]
    assert list(window.starts()) == []


def test_two_homes_and_two_displays_do_not_meet(window: SingleInstance, tmp_path: Path) -> None:
    for folder, display in ((tmp_path / "other", None), (tmp_path / "home", "far-10-0")):
        independent = begin(folder, Start("a.png"), display)
        with closing(independent):
            assert list(independent.starts()) == list(window.starts()) == []


def test_a_start_waits_for_a_window_that_ends(window: SingleInstance, tmp_path: Path) -> None:
    begun: list[SingleInstance | None] = []
    window.end()
    waiting = threading.Thread(target=lambda: begun.append(begin(tmp_path / "home", Start("a.png"))))
    waiting.start()
    time.sleep(0.3)
    assert begun == []
    assert list(window.starts()) == []
    window.close()
    waiting.join(60)
    (later,) = begun
    with closing(later):
        assert list(later.starts()) == []


@pytest.mark.parametrize("left", ["", "{", "[]", '{"image": "a.png", "colour": 1}'])
def test_a_damaged_file_of_a_start_is_ignored(window: SingleInstance, tmp_path: Path, left: str) -> None:
    (window_folder,) = (tmp_path / "home").iterdir()
    (window_folder / "0.json").write_text(left)
    assert handed_over(window, tmp_path / "home", Start("a.png")) == [Start("a.png")]
    assert [path.name for path in window_folder.iterdir()] == ["lock"]


_START = """
import sys, time
from pathlib import Path
from viewer.services.single_instance import Start, begin
while not Path(sys.argv[2]).exists():
    time.sleep(0.001)
window = begin(Path(sys.argv[1]), Start(sys.argv[3]))
print("window" if window else "handed over", flush=True)
taken = []
while window and len(taken) < 3:
    taken += [start.image for start in window.starts()]
    time.sleep(0.01)
print("".join(sorted(taken)))
"""


def test_one_of_simultaneous_starts_is_the_window(tmp_path: Path) -> None:
    home = tmp_path / "home"
    go = tmp_path / "go"
    words = [sys.executable, "-c", _START, home, go]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    started = {name: subprocess.Popen([*words, name], text=True, **pipes) for name in "abcd"}
    go.touch()
    said = {name: process.communicate()[0].split() for name, process in started.items()}
    (window,) = [name for name, lines in said.items() if lines[0] == "window"]
    later = "abcd".replace(window, "")
    assert said == {window: ["window", later]} | {name: ["handed", "over"] for name in later}


def test_a_window_that_was_killed_holds_nothing(tmp_path: Path) -> None:
    (tmp_path / "go").touch()
    words = [sys.executable, "-c", _START, tmp_path / "home", tmp_path / "go", "a"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as killed:
        assert killed.stdout.readline() == "window\n"
        killed.kill()
    window = begin(tmp_path / "home", Start())
    window.close()
