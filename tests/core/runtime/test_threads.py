import os
import subprocess
import sys
from pathlib import Path

import pytest

from core.runtime.threads import VARIABLE, available_cores, thread_count

_COUNT = "import torch, numpy; print(torch.get_num_threads())"


def run(program: str, **environment: str) -> str:
    inherited = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, env=inherited | environment, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_use_one_torch_thread_overrides_the_environment():
    begun = f"from core.runtime.threads import use_one_torch_thread; use_one_torch_thread(); {_COUNT}"
    assert run(begun, OMP_NUM_THREADS="3", MKL_NUM_THREADS="3") == "1"


@pytest.mark.parametrize("module", ["core.__main__", "viewer.__main__"])
def test_programs_limit_torch_to_one_thread(module: str):
    tried = f"import {module} as program\ntry: program.main(['--help'])\nexcept SystemExit: {_COUNT}"
    assert run(tried, OMP_NUM_THREADS="3").splitlines()[-1] == "1"


def test_the_library_leaves_the_threads_of_torch_to_its_caller():
    """Threads begin with the first piece, and change the number neither of old threads nor of new ones."""
    program = """
import threading, torch
torch.set_num_threads(3)
import core.fitting.fit, core.photos.photo, core.models.library
core.models.library.load_model("chairs")
from core.runtime.pool import map_pieces
print(threading.active_count(), *map_pieces(lambda _: torch.get_num_threads(), range(2)), torch.get_num_threads())
new = threading.Thread(target=lambda: print(torch.get_num_threads()))
new.start(), new.join()
"""
    assert run(program, **{VARIABLE: "2"}).split() == ["1", "1", "1", "3", "3"]


def test_the_thread_count_is_that_of_the_environment_or_the_cores(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(VARIABLE, "5")
    assert thread_count() == 5
    monkeypatch.delenv(VARIABLE)
    assert thread_count() == available_cores() >= 1
    for wrong in ("0", "-1", "two", ""):
        monkeypatch.setenv(VARIABLE, wrong)
        with pytest.raises(ValueError, match=VARIABLE):
            thread_count()


def test_a_container_limits_cores(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: range(16), raising=False)
    limits = {"cpu.max": "250000 100000", "cpu.cfs_quota_us": "400000", "cpu.cfs_period_us": "100000"}
    for cores, version, files in ((3, "two", ["cpu.max"]), (4, "one", ["cpu.cfs_quota_us", "cpu.cfs_period_us"])):
        folder = tmp_path / version
        (folder / "cpu").mkdir(parents=True)
        for name in files:
            (folder / name if version == "two" else folder / "cpu" / name).write_text(limits[name] + "\n")
        assert available_cores(folder) == cores
    (tmp_path / "cpu.max").write_text("max 100000\n")
    assert available_cores(tmp_path) == available_cores(tmp_path / "nothing") == 16


@pytest.mark.parametrize(("folder", "line"), [("", "0::/outer/inner"), ("cpu", "1:cpu,cpuacct:/outer/inner")])
def test_any_group_around_the_process_limits_cores(
    folder: str, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: range(16), raising=False)
    inner = tmp_path / folder / "outer" / "inner"
    inner.mkdir(parents=True)
    groups = tmp_path / "groups"
    groups.write_text(f"5:memory:/elsewhere\n{line}\n")
    for group, cores in ((inner, 5), (inner.parent, 2)):
        (group / "cpu.max").write_text(f"{cores}00 100\n")
        (group / "cpu.cfs_quota_us").write_text(f"{cores}00\n")
        (group / "cpu.cfs_period_us").write_text("100\n")
        available_cores.cache_clear()
        assert available_cores(tmp_path, groups) == cores
