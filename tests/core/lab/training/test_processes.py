"""Training on two processes that torchrun starts, compared with training on one."""

import json
import os
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from core.__main__ import main
from core.lab.datasets.srn import Dataset, write_object
from core.lab.training.processes import ALONE, Processes, training_processes
from core.lab.training.ray_dataset import RayDataset
from tests.core.lab.training.test_trainer import coloured

_ROOT = Path(__file__).parents[4]
_BALLS = (
    coloured("red", (200, 30, 20), (0.1, 0, 0)),
    coloured("blue", (10, 40, 220), (-0.1, 0.05, 0)),
    coloured("green", (20, 200, 30), (0, 0.1, 0)),
)
_SIZES = "train d --width 16 --latent 4 4 --rays 96"


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands are typed in a folder of their own."""
    monkeypatch.chdir(tmp_path)


def torchrun(words: str, processes: int = 2) -> subprocess.CompletedProcess[str]:
    """Start a command in processes that find each other also on a machine whose name is unknown to the network."""
    launcher = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--local-addr=127.0.0.1"]
    command = [*launcher, f"--nproc-per-node={processes}", "-m", "core", *words.split()]
    loopback = next(name for _, name in socket.if_nameindex() if name.startswith("lo"))
    environment = os.environ | {"PYTHONPATH": str(_ROOT), "GLOO_SOCKET_IFNAME": loopback}
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=600)


def curve(name: str) -> list[float]:
    return [point["psnr"] for point in json.loads(Path(f"{name}.curve.json").read_text())[name]]


def test_two_processes_resume_the_run_of_one_and_train_like_it():
    for views in _BALLS:
        write_object("d", views)
    main(f"{_SIZES} --out two.safetensors --steps 8".split())
    for end in (".state", ".curve.json"):
        Path(f"one{end}").write_bytes(Path(f"two{end}").read_bytes().replace(b'"two"', b'"one"'))
    main(f"{_SIZES} --out one.safetensors --steps 40 --resume".split())
    done = torchrun(f"{_SIZES} --out two.safetensors --steps 40 --resume")
    assert done.returncode == 0, done.stderr
    assert (done.stdout + done.stderr).count("on held-out views") == 1
    assert curve("two") == pytest.approx(curve("one"), abs=0.01)
    single, double = (torch.load(f"{name}.state", weights_only=True) for name in ("one", "two"))
    assert torch.equal(single["generator"], double["generator"])
    assert torch.equal(single["hulls"], double["hulls"])
    torch.testing.assert_close(double["codes"], single["codes"], atol=1e-3, rtol=1e-3)
    torch.testing.assert_close(double["field"], single["field"], atol=2e-3, rtol=1e-2)  # Muon computes in bfloat16
    assert not list(Path().glob("*.partial*"))


def test_an_error_of_all_processes_is_printed_once():
    done = torchrun("train missing --out x.safetensors")
    assert done.returncode != 0
    assert done.stderr.count("missing: no such dataset folder") == 1
    assert "core/lab" not in done.stderr  # no traceback of this program


def test_batches_of_two_processes_make_up_the_batch_of_one():
    dataset = Dataset(_BALLS, "balls", 32, _BALLS[0].cameras[0].focal, weights=(1.0, 2.0, 3.0))

    def batch(processes: Processes):
        rays = RayDataset(dataset, (0.5, 0.5, 0.5), torch.device("cpu"), True, processes)
        return rays.sample(64, torch.Generator().manual_seed(0))

    full = batch(ALONE)
    halves = [batch(Processes(rank, 2)) for rank in range(2)]
    assert [set(half.owner.tolist()) for half in halves] == [{0, 2}, {1}]
    order = torch.cat([half.place for half in halves]).argsort()
    for name in ("owner", "colours", "mask_class"):
        torch.testing.assert_close(torch.cat([getattr(half, name) for half in halves])[order], getattr(full, name))
    directions = torch.cat([half.rays.directions for half in halves])[order]
    torch.testing.assert_close(directions, full.rays.directions)


def test_more_processes_than_objects_are_refused():
    dataset = replace(Dataset(_BALLS, "balls", 32, 40.0), objects=_BALLS[:1])
    with pytest.raises(ValueError, match="2 processes need as many objects, got 1"):
        RayDataset(dataset, (0.5, 0.5, 0.5), torch.device("cpu"), True, Processes(0, 2))


def test_without_torchrun_a_process_is_alone():
    with training_processes("cpu") as processes:
        assert processes == Processes(0, 1)
