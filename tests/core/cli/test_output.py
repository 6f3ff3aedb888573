"""Real commands whose standard output, error or log ends before they do."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.core.cli.conftest import draw, write_pose
from tests.core.tiny import tiny_model

pytestmark = pytest.mark.skipif(not shutil.which("bash"), reason="pipes are bash's")
ROOT = Path(__file__).parents[3]


@pytest.fixture
def folder(here: Path, tiny_file: str) -> Path:
    """A model, one photo and its camera."""
    draw(here / "a.png", (200, 30, 30))
    write_pose(here / "p.txt", tiny_model())
    (here / "temporary").mkdir()
    return here


def shell(folder: Path, words: str) -> subprocess.CompletedProcess[str]:
    """Run a line of bash; ``core`` in it is the command line."""
    line = f'set -o pipefail; core() {{ PYTHONPATH="{ROOT}" "{sys.executable}" -m core "$@"; }}; {words}'
    env = os.environ | {"TMPDIR": str(folder / "temporary")}
    return subprocess.run(["bash", "-c", line], cwd=folder, env=env, capture_output=True, text=True, check=False)


FIT = "core fit a.png --model m.safetensors --pose p.txt --preset draft --out s.json"


@pytest.mark.parametrize(
    ("words", "status", "lost"),
    [
        (f"{FIT} | true", 0, "standard output"),
        (f"{FIT} 2>&1 | true", 0, ""),
        (f"{FIT} --log >(head -1 >first)", 0, "/dev/fd/"),
        (f"{FIT} --log /dev/full", 0, "/dev/full"),
        (f"{FIT} > /dev/full", 1, "standard output"),
        (f"{FIT} >&- 2>&-", 0, ""),
    ],
)
def test_a_fit_is_saved_although_its_output_is_closed(folder: Path, words: str, status: int, lost: str) -> None:
    done = shell(folder, words)
    assert json.loads((folder / "s.json").read_text())["camera"]
    assert done.returncode == status, done.stderr
    said = done.stderr.splitlines()
    assert [line for line in said if "cannot be written any more" in line] == said
    assert len(said) == bool(lost)
    assert not lost or lost in said[0]
    assert not any((folder / "temporary").iterdir())


def test_every_command_ends_well_without_a_reader(folder: Path) -> None:
    for words in ("--help", "fit --help"):
        done = shell(folder, f"core {words} | true")
        assert done.returncode == 0, done.stderr
        assert "Exception" not in done.stderr


def test_a_fit_whose_file_cannot_be_written_prints_its_result(folder: Path) -> None:
    """The folder of the scene is removed while the fit runs: the scene is written elsewhere."""
    (folder / "gone").mkdir()
    watch = "(read line; rm -r gone; cat >rest)"
    done = shell(folder, f"{FIT.replace('s.json', 'gone/s.json')} --log >{watch} ")
    assert done.returncode == 2
    (elsewhere,) = (folder / "temporary").glob("codenerf-*/s.json")
    assert f"it is in {elsewhere} instead" in done.stderr
    assert json.loads(done.stdout)["azimuth"] == pytest.approx(60, abs=1e-3)
