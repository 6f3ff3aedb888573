"""Commands that make data and models."""

import json
import shutil
from pathlib import Path

import pytest
import torch

from core.lab.datasets.srn import read_dataset
from core.models.library import load_model
from tests.core.cli.conftest import run
from tests.core.lab.datasets.test_glb_objects import write_folder

pytestmark = pytest.mark.usefixtures("here")


def test_convert_writes_a_model_file(shared: Path, capsys: pytest.CaptureFixture[str]):
    source = shared / "upstream/srncars500"
    shutil.copy(source / "models.pth", "models.pth")
    run(f"convert models.pth --config {source / 'hpam.json'} --out c.safetensors")
    assert "24, 142, 149" in capsys.readouterr().out
    assert len(load_model("c.safetensors").codes) == 500


@pytest.mark.usefixtures("rasteriser")
def test_meshes_become_a_dataset_and_the_dataset_a_model():
    write_folder(Path(), ["one", "two"])
    run("dataset meshes . --category chairs --views 6 --size 24 --out d")
    assert len(read_dataset(Path("d")).objects) == 2
    run("train d --width 16 --latent 4 4 --out m.safetensors --steps 8")
    for end in (".safetensors", ".state", ".curve.json"):
        Path(f"m{end}").rename(f"n{end}")
    run("train d --width 16 --latent 4 4 --out n.safetensors --steps 12 --resume")
    assert load_model("n.safetensors").category == "chairs"
    curve = json.loads(Path("n.curve.json").read_text())
    assert [point["step"] for point in curve["n"]] == [8, 12]
    assert Path("n.curve.png").exists()
    run("train d --init n.safetensors --steps 2 --out more.safetensors")
    extended = load_model("more.safetensors")
    initial = load_model("n.safetensors")
    assert extended.field.config == initial.field.config
    weights, initial_weights = (model.viewpoint_classifier.state_dict() for model in (extended, initial))
    assert all(torch.equal(weights[name], initial_weights[name]) for name in initial_weights)
    run("train-viewpoint d --model n.safetensors --steps 1 --out looks.safetensors")
    looks = load_model("looks.safetensors")
    assert looks.fingerprint == initial.fingerprint
    assert looks.viewpoint_classifier is not None


def test_train_parts_adds_a_part_head(capsys):
    run("train-parts --model cars --labels cars --objects 2 --out parts.safetensors")
    assert "body, wheels, glass: " in capsys.readouterr().out
    model = load_model("parts.safetensors")
    assert model.fingerprint == load_model("cars").fingerprint
    assert model.part_head.names == ("body", "wheels", "glass")
