import socket
import stat
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


def test_a_second_start_is_handed_over(window: SingleInstance, tmp_path: Path) -> None:
    woken = []
    window.wake = lambda: woken.append(True)
    assert begin(tmp_path / "home", Start("/photos/chaise à l'été.png", "cars")) is None
    assert begin(tmp_path / "home", Start()) is None
    assert list(window.starts()) == [Start("/photos/chaise à l'été.png", "cars"), Start()]
    assert list(window.starts()) == []
    assert len(woken) == 2


def test_two_homes_do_not_meet(window: SingleInstance, tmp_path: Path) -> None:
    other = begin(tmp_path / "other", Start("a.png"))
    assert other is not None
    with closing(other):
        assert begin(tmp_path / "other", Start("b.png")) is None
        assert list(other.starts()) == [Start("b.png")]
    assert list(window.starts()) == []


def test_the_next_window_opens_once_the_first_is_closed(window: SingleInstance, tmp_path: Path) -> None:
    window.close()
    assert not (tmp_path / "home" / "window.address").exists()
    later = begin(tmp_path / "home", Start())
    assert later is not None
    later.close()


def test_a_start_waits_for_a_window_that_ends(window: SingleInstance, tmp_path: Path) -> None:
    begun: list[SingleInstance | None] = []
    window.end()
    waiting = threading.Thread(target=lambda: begun.append(begin(tmp_path / "home", Start("a.png"))))
    waiting.start()
    time.sleep(0.3)
    assert begun == []
    window.close()
    waiting.join(30)
    (later,) = begun
    assert later is not None
    later.close()
    assert list(window.starts()) == []


def _mute() -> socket.socket:
    return socket.create_server(("127.0.0.1", 0))


@pytest.mark.parametrize("left", ["", "1", "words and more", "70000 key", "1 key", "mute"])
def test_what_a_crash_left_stops_no_start(tmp_path: Path, left: str) -> None:
    """Nobody listens there any more, or another program, which says nothing."""
    with _mute() as other:
        left = f"{other.getsockname()[1]} key" if left == "mute" else left
        (tmp_path / "window.address").write_text(left)
        window = begin(tmp_path, Start())
    assert window is not None
    with closing(window):
        assert begin(tmp_path, Start("a.png")) is None
        assert list(window.starts()) == [Start("a.png")]


def test_who_does_not_know_the_key_is_not_heard(window: SingleInstance, tmp_path: Path) -> None:
    port = int((tmp_path / "home" / "window.address").read_text().split()[0])
    for line in (b'["key", "a.png", ""]\n', b"[]\n", b"GET / HTTP/1.1\r\n", b"[" * 9000 + b"\n", b"\xff\n"):
        with socket.create_connection(("127.0.0.1", port), 30) as connection:
            connection.sendall(line)
            assert connection.recv(100) == b""
    assert list(window.starts()) == []
    assert begin(tmp_path / "home", Start()) is None


@pytest.mark.skipif(sys.platform == "win32", reason="a user's folder is closed to others there")
def test_the_key_is_for_its_user_alone(window: SingleInstance, tmp_path: Path) -> None:
    assert stat.S_IMODE((tmp_path / "home" / "window.address").stat().st_mode) == 0o600


_START = """
import sys, time
from pathlib import Path
from viewer.services.single_instance import Start, begin
while not Path(sys.argv[2]).exists():
    time.sleep(0.001)
window = begin(Path(sys.argv[1]), Start(sys.argv[3]))
print("window" if window else "handed over", flush=True)
if window:
    sys.stdin.read()
    print("".join(sorted(start.image for start in window.starts())))
"""


def test_of_starts_at_once_one_is_the_window(tmp_path: Path) -> None:
    home, go = tmp_path / "home", tmp_path / "go"
    home.mkdir()
    (home / "window.address").write_text("1 key")  # of a window that crashed
    words = [sys.executable, "-c", _START, home, go]
    started = {
        name: subprocess.Popen([*words, name], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for name in "abcd"
    }
    go.touch()
    became = {name: process.stdout.readline().strip() for name, process in started.items() if process.stdout}
    (window,) = [name for name, what in became.items() if what == "window"]
    others = "abcd".replace(window, "")
    assert all(became[name] == "handed over" for name in others)
    left = {name: process.communicate()[0].strip() for name, process in started.items()}
    assert left == {window: others} | dict.fromkeys(others, "")
