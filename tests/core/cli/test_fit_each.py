"""Many photos, one object each: rows, failures, interruptions, and processes."""

import json
import os
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest

from core.__main__ import main
from core.cli.fit import photos_at
from tests.conftest import image_size
from tests.core.cli.conftest import draw, write_pose
from tests.core.tiny import tiny_model

_ROOT = Path(__file__).parents[3]
_COLOURS = {"red.png": (200, 30, 30), "green.png": (30, 160, 30), "blue.png": (30, 30, 200)}


@pytest.fixture(autouse=True)
def photos(tiny_file: str) -> None:
    """Three photos of blocks, and the camera of all."""
    for name, colour in _COLOURS.items():
        draw(Path(name), colour)
    write_pose(Path("p.txt"), tiny_model())


def words(*photos: str, out: str = "out", more: str = "") -> list[str]:
    poses = ["p.txt"] * len(photos)
    options = f"--model m.safetensors --preset draft --out {out} {more}".split()
    return ["fit", "--each", *photos, "--pose", *poses, *options]


def lines(out: str = "out") -> list[str]:
    path = Path(out, "rows.jsonl")
    return path.read_text().splitlines(keepends=True) if path.exists() else []


def names(out: str = "out") -> list[str]:
    return sorted(Path(json.loads(line)["photo"]).name for line in lines(out))


def test_every_photo_has_a_row_and_a_failure_stops_no_other_fit(capsys: pytest.CaptureFixture[str]):
    Path("bad.png").write_text("no image")
    main(words("bad.png", "red.png", "missing.png", "red.png"))
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "1 of 3 photos are fitted, 2 failed (out/rows.jsonl says why): out/contact-sheet.png" in printed.err
    bad, red, missing = map(json.loads, lines())
    assert "bad.png: this is not an image" in bad["error"]
    assert "no such image" in missing["error"]
    assert red["azimuth"] == pytest.approx(60, abs=1e-3)
    assert json.loads(Path("out", f"{red['key']}.json").read_text())["camera"]
    assert image_size(Path("out/contact-sheet.png"))[0] > 600


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_in_a_folder_of_photos_is_refused_without_waiting():
    Path("photos").mkdir()
    os.mkfifo("photos/a.png")
    main(["fit", "--each", "photos", "--model", "m.safetensors", "--preset", "draft", "--out", "out"])
    (row,) = map(json.loads, lines())
    assert "photos/a.png is a pipe or a device" in row["error"]


def test_only_photos_without_a_result_are_fitted():
    main(words("red.png", "green.png"))
    first_lines = lines()
    Path("bad.png").write_text("no image")
    Path("out/rows.jsonl").write_text("".join(first_lines) + '{"photo": "blue.png", "key')  # cut off
    Path("moved").mkdir()
    Path("green.png").rename("moved/green.png")
    main(words("red.png", "moved/green.png", "bad.png"))
    assert lines()[:2] == first_lines
    assert names() == ["bad.png", "green.png", "red.png"]
    draw(Path("bad.png"), (9, 9, 9))
    Path("out", f"{json.loads(first_lines[0])['key']}.json").unlink()
    main(words("red.png", "moved/green.png", "bad.png"))
    assert names() == ["bad.png", "green.png", "red.png"]
    assert lines()[0] == first_lines[1]
    assert not any("error" in json.loads(line) for line in lines())
    main(words("red.png", more="--seed 1"))
    assert names() == ["bad.png", "green.png", "red.png", "red.png"]


def test_a_folder_of_photos_is_one_object():
    Path("sides").mkdir()
    Path("red.png").rename("sides/a.png")
    Path("sides/b.png").write_text("no image")
    main(["fit", "--each", "sides", "--model", "m.safetensors", "--out", "out"])
    (row,) = map(json.loads, lines())
    assert Path(row["photo"]).name == "sides" and "b.png: this is not an image" in row["error"]
    assert [path.name for path in photos_at(Path("sides"))] == ["a.png", "b.png"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["fit", "--each", "red.png"], "--each needs a folder for its results: --out FOLDER"),
        (words("red.png", more="--log a.jsonl"), "--log, --explain and --resume are of a single fit"),
        (words("red.png", out="p.txt"), "cannot write p.txt: it is not a folder"),
        (["fit", "red.png", "--cluster", "tcp://127.0.0.1:1"], "add --each"),
        (["fit", "--each", "out", "--out", "out"], "out: no images in this folder"),
        (["fit", "--each", ".", "--out", "out", "--box", "1,2,3,4"], "not of a video or a folder"),
        (["fit", "--each", "red.png", "--out", "out", "--box", "1,2,3,4", "1,2,3,4"], "1 images need as many boxes"),
    ],
)
def test_contradicting_options_are_refused(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    assert stopped.value.code == 2
    assert message in capsys.readouterr().err
    assert not lines()


def python(*arguments: str, path: str = str(_ROOT)) -> subprocess.CompletedProcess[str]:
    """Run a program of its own."""
    env = os.environ | {"PYTHONPATH": path}
    return subprocess.run([sys.executable, *arguments], env=env, capture_output=True, text=True, check=False)


def children(process: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def is_alive(process: int) -> bool:
    status = Path(f"/proc/{process}/stat")
    return status.exists() and status.read_text().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.skipif(not Path(f"/proc/self/task/{os.getpid()}/children").exists(), reason="reads processes of Linux")
def test_a_killed_command_leaves_no_process_and_goes_on_when_started_again():
    command = [sys.executable, "-m", "core", *words(*_COLOURS, more="--threads 2")]
    running = subprocess.Popen(command, env=os.environ | {"PYTHONPATH": str(_ROOT)}, stderr=subprocess.PIPE)
    while not lines() and running.poll() is None:
        time.sleep(0.05)
    workers = children(running.pid)
    running.send_signal(signal.SIGKILL)
    running.communicate()
    first_lines = [line for line in lines() if line.endswith("\n")]
    assert first_lines
    assert len(workers) >= 2
    while any(map(is_alive, workers)):
        time.sleep(0.05)
    main(words(*_COLOURS))
    assert lines()[: len(first_lines)] == first_lines
    assert names() == sorted(_COLOURS)


_DEADLY = """
import os
import sys
from pathlib import Path

def end(event, arguments):
    name = Path(str(arguments[0])).name if event == "open" else ""
    if "PARENT" in os.environ and os.getpid() != int(os.environ["PARENT"]):
        if name == "deadly.png" or (name == "once.png" and not Path("died").exists()):
            Path("died").touch()
            os._exit(1)

sys.addaudithook(end)
"""
_COMMAND = """
import os, sys
os.environ["PARENT"] = str(os.getpid())
from core.__main__ import main
main(sys.argv[1:])
"""


def test_a_killed_process_ends_no_other_fit_and_its_photos_are_retried_once():
    Path("sitecustomize.py").write_text(_DEADLY)  # every process runs it first
    for name in ("deadly.png", "once.png"):
        draw(Path(name), (90, 60, 30))
    photos = ("red.png", "deadly.png", "once.png")
    path = os.pathsep.join([str(Path().absolute()), str(_ROOT)])
    done = python("-c", _COMMAND, *words(*photos, more="--threads 2"), path=path)
    assert "2 of 3 photos are fitted, 1 failed" in done.stderr
    assert done.returncode == 0
    assert Path("died").exists()
    errors = {Path(row["photo"]).name: row.get("error", "") for row in map(json.loads, lines())}
    assert sorted(errors) == sorted(photos)
    assert "its process died" in errors.pop("deadly.png")
    assert not any(errors.values())


_ON_A_CLUSTER = """
import sys
from distributed import LocalCluster
from core.__main__ import main

if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        main([*sys.argv[1:], "--cluster", cluster.scheduler_address])
"""


@pytest.mark.skipif(not find_spec("distributed"), reason="needs the extra cluster")
def test_a_dask_cluster_gives_the_same_files():
    photos = ("red.png", "green.png", "missing.png")
    Path("cluster.py").write_text(_ON_A_CLUSTER)
    done = python("cluster.py", *words(*photos, out="far"))
    assert done.returncode == 0, done.stderr
    main(words(*photos, out="near"))
    far, near = (sorted(map(json.loads, lines(out)), key=lambda row: row["key"]) for out in ("far", "near"))
    assert [row["photo"] for row in far] == [row["photo"] for row in near]
    assert [row.get("psnr") for row in far] == [row.get("psnr") and pytest.approx(row["psnr"], abs=1) for row in near]
    assert sorted(path.name for path in Path("far").iterdir()) == sorted(path.name for path in Path("near").iterdir())
