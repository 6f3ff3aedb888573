"""Evaluation, and datasets in NeRF's layout, which other commands read too."""

import json
from pathlib import Path

import pytest
from PIL import Image

from core.fitting.fit import PRESETS, FitSettings
from core.lab.datasets.srn import write_manifest, write_object
from core.models.library import load_model
from tests.core.cli.conftest import refused, run
from tests.core.lab.datasets.test_srn import write_nerf
from tests.core.lab.evaluation.test_protocol import views_of
from tests.core.tiny import SIDE, tiny_model

pytestmark = pytest.mark.usefixtures("quick", "tiny_file")


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PRESETS, "normal", FitSettings(steps=40, rays=96, samples=20))


def write_stools() -> None:
    """A dataset of three objects of the tiny model, each seen three times."""
    for index in range(3):
        write_object(Path("d"), views_of(tiny_model(), index, 3))


def test_nerf_folders_are_fitted_evaluated_and_trained_on(capsys: pytest.CaptureFixture[str]):
    for index in range(2):
        write_nerf(Path("d"), views_of(tiny_model(), index, 3), 0.3)
    photos = "d/stool0/train/r_0.png d/stool0/train/r_1.png --pose d/stool0/transforms_train.json"
    assert "across instead of 1: --pose-scale 0." in refused(capsys, f"fit {photos} --model m.safetensors")
    run(f"fit {photos} --model m.safetensors --pose-scale 0.3 --preset draft")
    fitted = json.loads(capsys.readouterr().out)
    assert fitted["distance"] == pytest.approx(tiny_model().distance, rel=1e-3)
    assert fitted["psnr"] > 20
    run("evaluate d --model m.safetensors --input-views 0,1 --pose-scale 0.3 --report r.json")
    assert evaluated("r.json") == ["stool0", "stool1"]
    assert json.loads(Path("r.json").read_text())["summary"]["psnr"][0] > 20
    run("train d --pose-scale 0.3 --width 16 --latent 4 4 --steps 2 --out n.safetensors")
    run("train d --pose-scale 0.3 --recipe M2 --width 16 --latent 4 4 --steps 2 --out ablation.safetensors")
    assert load_model("ablation.safetensors").is_ablation
    assert len(load_model("n.safetensors").codes) == 2


def evaluated(report: str) -> list[str]:
    return [score["name"] for score in json.loads(Path(report).read_text())["objects"]]


def test_evaluate_prints_the_table_and_writes_a_report(capsys: pytest.CaptureFixture[str]):
    write_stools()
    words = "evaluate d --model m.safetensors"
    run(f"{words} --input-views 0,1 --objects 1 --report r.json")
    assert "2-view (0, 1), camera known" in capsys.readouterr().out
    assert evaluated("r.json") == ["stool0"]
    assert json.loads(Path("r.json").read_text())["summary"]["psnr"][0] > 20
    assert "stool0: 3 views" in refused(capsys, f"{words} --input-views 7")
    write_manifest(Path("d"), "boats", {})
    assert "boats" in refused(capsys, f"{words} --input-views 0,1")


def test_evaluate_names_and_skips_blank_objects_and_keeps_its_scores(capsys: pytest.CaptureFixture[str]):
    """Object 1 of three shows nothing, and of the last a file is broken."""
    write_stools()
    for kind, colour in (("rgb", "white"), ("mask", "black")):
        for path in Path("d/stool1", kind).iterdir():
            Image.new("RGB", (SIDE, SIDE), colour).save(path)
    Path("d/stool2/rgb/000002.png").write_bytes(b"broken")
    with pytest.raises(SystemExit):
        run("evaluate d --model m.safetensors --input-views 0,1 --report r.json")
    skipped, broken = capsys.readouterr().err.strip().splitlines()
    assert "stool1 is skipped: view 0 shows no object" in skipped
    assert "000002.png: this is not an image" in broken
    assert evaluated("r.json") == ["stool0"]
