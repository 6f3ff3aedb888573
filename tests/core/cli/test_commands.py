"""The command line as a person types it, in this process."""

import json
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import ExifTags, Image

from core.__main__ import main
from core.classifiers.category import CategoryClassifier
from core.cli import fit as fitting
from core.fitting import fit as fits
from core.fitting.fit import PRESETS, FitStep, RunnerUp
from core.lab.benchmarks import ablations, robustness
from core.lab.datasets.srn import read_dataset, write_manifest, write_object
from core.models.library import load_model
from core.models.model import Model
from core.models.scene import Scene
from core.photos.photo import Photo
from tests.core.lab.evaluation.test_protocol import views_of
from tests.core.tiny import SIDE, tiny_model


@pytest.fixture
def file(model: Model, tmp_path: Path) -> str:
    model.save(tmp_path / "m.safetensors")
    return str(tmp_path / "m.safetensors")


def run(*words: object) -> None:
    main([str(word) for word in words])


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    """What a wrong call says; one line, status 2, nothing on stdout."""
    with pytest.raises(SystemExit) as stopped:
        run(*words)
    said = capsys.readouterr()
    assert stopped.value.code == 2
    assert said.out == ""
    assert len(said.err.strip().splitlines()) == 1
    assert "Traceback" not in said.err
    return said.err


def test_render_draws_objects_scenes_and_the_mean(file: str, model: Model, tmp_path: Path):
    run(
        "render",
        "--model",
        file,
        "--object",
        2,
        "--azimuth",
        30,
        "--elevation",
        10,
        "--distance",
        2,
        "--size",
        24,
        "--out",
        tmp_path / "a.png",
    )
    Scene(model.fingerprint, model.codes[2], model.camera(np.radians(30), np.radians(10))).save(tmp_path / "s.json")
    run("render", "--model", file, "--scene", tmp_path / "s.json", "--size", 24, "--out", tmp_path / "b.png")
    run("render", "--model", file, "--size", 24, "--out", tmp_path / "mean.png")
    a, b, mean = (np.asarray(Image.open(tmp_path / name)) for name in ("a.png", "b.png", "mean.png"))
    assert a.shape == (24, 24, 3)
    assert np.array_equal(a, b)
    assert not np.array_equal(a, mean)


def test_exact_is_the_reference_and_close(file: str, tmp_path: Path):
    for name, more in (("fast.png", ()), ("exact.png", ("--exact",))):
        run("render", "--model", file, "--object", 0, "--size", 24, "--out", tmp_path / name, *more)
    fast, exact = (np.asarray(Image.open(tmp_path / name)).astype(float) for name in ("fast.png", "exact.png"))
    assert 0 < np.abs(fast - exact).mean() < 4


def test_a_turntable_becomes_another_object_and_turns_back(file: str, model: Model, tmp_path: Path):
    about = "--object 0 --morph-to 1 --distance 2 --frames 4 --size 24 --fps 12 --transparent --exact"
    words = about.split()
    run("turntable", "--model", file, *words, "--out", tmp_path / "t.frames")
    there = ("--object", 1, "--azimuth", 240, "--distance", 2, "--size", 24)
    run("render", "--model", file, *there, "--out", tmp_path / "there.png")
    assert len(list((tmp_path / "t.frames").iterdir())) == 4
    with Image.open(tmp_path / "t.frames/00002.png") as halfway, Image.open(tmp_path / "there.png") as there:
        white = Image.new("RGBA", halfway.size, "white")
        white.alpha_composite(halfway)
        seen = np.asarray(white.convert("RGB")).astype(int)
        assert np.abs(seen - np.asarray(there)).max() <= 3


def test_mesh_writes_the_object(tmp_path: Path):
    tiny_model().save(tmp_path / "m.safetensors")
    run(*f"mesh --model {tmp_path}/m.safetensors --object 1 --resolution 24 --out {tmp_path}/a.ply".split())
    assert (tmp_path / "a.ply").read_bytes().startswith(b"ply")
    about = "--resolution 24 --texture 64 --metres 0.9"
    run(*f"mesh --model {tmp_path}/m.safetensors --object 1 {about} --out {tmp_path}/a.glb".split())
    assert b"baseColorTexture" in (tmp_path / "a.glb").read_bytes()


def test_convert_writes_a_model_file(shared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    source = shared / "upstream/srncars500"
    shutil.copy(source / "models.pth", tmp_path / "models.pth")
    run("convert", tmp_path / "models.pth", "--config", source / "hpam.json", "--out", tmp_path / "c.safetensors")
    assert "24, 142, 149" in capsys.readouterr().out
    assert len(load_model(str(tmp_path / "c.safetensors")).codes) == 500


def test_evaluate_prints_the_table_and_writes_a_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    tiny = tiny_model()
    tiny.save(tmp_path / "m.safetensors")
    for index in range(3):
        write_object(tmp_path / "d", views_of(tiny, index, 3))
    words = ("evaluate", tmp_path / "d", "--model", tmp_path / "m.safetensors", "--input-views", "0,1", "--objects", 1)
    run(*words, "--report", tmp_path / "r.json")
    assert "2-view (0, 1), camera known" in capsys.readouterr().out
    printed = json.loads((tmp_path / "r.json").read_text())
    assert [one["name"] for one in printed["objects"]] == ["stool0"]
    assert printed["summary"]["psnr"][0] > 20
    assert (tmp_path / "r.png").exists()
    assert "stool0: 3 views" in refused(capsys, *words[:4], "--input-views", "7")
    assert "no held-out pair" in refused(capsys, *words[:4], "--disentanglement")
    assert "no --input-views" in refused(capsys, *words, "--disentanglement")
    write_manifest(tmp_path / "d", "boats", {})
    assert "boats" in refused(capsys, *words)


def test_evaluate_names_and_skips_what_is_all_white_and_keeps_what_it_has(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """Object 1 of three shows nothing, and of the last a file is broken."""
    tiny_model().save(tmp_path / "m.safetensors")
    for index in range(3):
        write_object(tmp_path / "d", views_of(tiny_model(), index, 3))
    for path in (*(tmp_path / "d/stool1/rgb").iterdir(), *(tmp_path / "d/stool1/mask").iterdir()):
        Image.new("RGB", (SIDE, SIDE), "white" if path.parent.name == "rgb" else "black").save(path)
    (tmp_path / "d/stool2/rgb/000002.png").write_bytes(b"broken")
    words = ("evaluate", tmp_path / "d", "--model", tmp_path / "m.safetensors", "--input-views", "0,1")
    with pytest.raises(SystemExit):
        run(*words, "--report", tmp_path / "r.json")
    skipped, broken = capsys.readouterr().err.strip().splitlines()
    assert "stool1 is skipped: view 0 shows no object" in skipped
    assert "000002.png: this is not an image" in broken
    assert [one["name"] for one in json.loads((tmp_path / "r.json").read_text())["objects"]] == ["stool0"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("render", "--out", "{tmp}/a.png", "--model", "boats"), "boats"),
        (("render", "--out", "{tmp}/a.png", "--model", "{file}", "--object", "9"), "0 to 5"),
        (("render", "--out", "{tmp}/a.png", "--model", "{file}", "--elevation", "120"), "90 degrees"),
        (("render", "--out", "{tmp}/a.png", "--model", "{file}", "--distance", "-1"), "positive"),
        (("render", "--out", "{tmp}/gone/a.png", "--model", "{file}"), "folder"),
        (("render", "--out", "{tmp}", "--model", "{file}"), "it is a folder"),
        (("render", "--out", "{tmp}/a.xyz", "--model", "{file}", "--size", "8"), "name ends in"),
        (("render", "--out", "{tmp}/a.png", "--size", "none"), "--size"),
        (("render", "--out", "{tmp}/a.png", "--azimuth", "nan"), "--azimuth"),
        (("turntable", "--out", "{tmp}/t.avi", "--model", "{file}"), "mp4"),
        (("mesh", "--out", "{tmp}/a.stl", "--model", "{file}"), "glb"),
        (("convert", "{file}", "--out", "{tmp}/a.safetensors"), "hpam.json"),
        (("convert", "{file}", "--config", "{file}", "--out", "{tmp}/a.pth"), "safetensors"),
        (("evaluate", "{tmp}/gone", "--model", "{file}"), "no such dataset"),
        (("evaluate", "{tmp}", "--model", "{file}", "--input-views", "64,,1"), "--input-views"),
        (("evaluate", "{tmp}", "--model", "{file}", "--input-views", "3,3"), "different views"),
        (("fit", "{tmp}/gone.png", "--model", "{file}"), "gone.png"),
        (("fit", "{file}", "--model", "{file}"), "m.safetensors"),
        (("fit", "a.png", "--out", "{tmp}"), "called .json"),
        (("fit", "a.png", "--log", "{tmp}"), "it is a folder"),
        (("fit", "a.png", "--out", "{tmp}/gone/a.json"), "no folder"),
        (("fit", "a.png", "b.png", "--model", "{file}", "--pose", "p.txt"), "as many poses"),
        (("fit", "a.png", "--preset", "best"), "paper"),
        (("fit", "a.png", "--preset", "paper", "--estimate-focal"), "focal length"),
        (("fit", "a.png", "--pose", "a.txt", "--estimate-focal"), "--pose gives them"),
        (("bench", "fit", "--dataset", "{tmp}/gone", "--model", "{file}"), "no such dataset"),
        (("train", "{tmp}", "--out", "{tmp}/x.safetensors"), "no object folders"),
        (("train", "{tmp}", "--init", "{file}", "--width", "32", "--out", "{tmp}/x.safetensors"), "no --width"),
        (("dataset", "meshes", "{tmp}", "--out", "{tmp}/d", "--category", "chairs"), "index.json"),
        (("nonsense",), "nonsense"),
        ((), "COMMAND"),
    ],
)
def test_wrong_input_is_said_in_one_line(words, says, file, tmp_path, capsys):
    filled = [word.format(tmp=tmp_path, file=file) for word in words]
    assert says in refused(capsys, *filled)


@pytest.mark.usefixtures("rasteriser")
def test_dataset_train_and_render_from_nothing(tmp_path: Path):
    """Objects of the generator become a dataset, the dataset a model, the model an image; and training resumes."""
    words = ("dataset", "procedural", "--category", "chairs", "--count", 2, "--views", 6, "--size", 24)
    run(*words, "--out", tmp_path / "d")
    assert len(read_dataset(tmp_path / "d").objects) == 2
    words = ("train", tmp_path / "d", "--width", 16, "--latent", 4, 4, "--out")
    run(*words, tmp_path / "m.safetensors", "--steps", 8)
    for end in (".safetensors", ".state", ".curve.json"):
        (tmp_path / f"m{end}").rename(tmp_path / f"n{end}")
    out = tmp_path / "n.safetensors"
    run(*words, out, "--steps", 12, "--resume")
    assert load_model(str(out)).category == "chairs"
    curve = json.loads((tmp_path / "n.curve.json").read_text())
    assert [point["step"] for point in curve["n"]] == [8, 12]
    assert (tmp_path / "n.curve.png").exists()
    run("train", tmp_path / "d", "--init", out, "--steps", 2, "--out", tmp_path / "more.safetensors")
    more, before = load_model(str(tmp_path / "more.safetensors")), load_model(str(out))
    assert more.field.config == before.field.config
    assert more.viewpoint_classifier is not None
    assert before.viewpoint_classifier is not None
    kept, former = more.viewpoint_classifier.state_dict(), before.viewpoint_classifier.state_dict()
    assert all(torch.equal(kept[name], former[name]) for name in former)
    run("render", "--model", out, "--object", 1, "--size", 16, "--out", tmp_path / "a.png")
    run("train-viewpoint", tmp_path / "d", "--model", out, "--steps", 1, "--out", tmp_path / "looks.safetensors")
    looks = load_model(str(tmp_path / "looks.safetensors"))
    assert looks.fingerprint == before.fingerprint
    assert looks.viewpoint_classifier is not None
    run("select-gallery", tmp_path / "d", "--model", out, "--count", 1, "--out", tmp_path / "small.safetensors")
    assert len(load_model(str(tmp_path / "small.safetensors")).codes) == 1
    write_object(tmp_path / "other", replace(read_dataset(tmp_path / "d").objects[0], name="boat"))
    write_manifest(tmp_path / "other", "boats", {})
    words = ("train-category", tmp_path / "d", tmp_path / "other", "--steps", 2)
    run(*words, "--out", tmp_path / "c.safetensors")
    assert CategoryClassifier.load(tmp_path / "c.safetensors").categories == ("boats", "chairs")
    shutil.rmtree(tmp_path / "d")


def test_bench_measures_fits_and_draws_their_charts(tmp_path, capsys, monkeypatch):
    tiny_model().save(tmp_path / "m.safetensors")
    for name, settings in PRESETS.items():
        monkeypatch.setitem(PRESETS, name, replace(settings, hypotheses=1, steps=2, rays=16, samples=8))
    monkeypatch.setattr(robustness, "STRESSORS", {"none": robustness.STRESSORS["none"]})
    words = ("--model", tmp_path / "m.safetensors", "--objects", 1, "--out", tmp_path / "charts")
    run("bench", "fit", *words)
    assert "| paper |" in capsys.readouterr().out
    run("bench", "robustness", *words)
    assert "| stressor | level | normal |" in capsys.readouterr().out
    before = (tmp_path / "charts/robustness.csv").read_text()
    run("bench", "robustness", *words, "--part", "1/2")  # nothing is left to measure
    assert (tmp_path / "charts/robustness.csv").read_text() == before
    write_object(tmp_path / "d", views_of(tiny_model(), 0, 3))
    run("bench", "fit", *words, "--dataset", tmp_path / "d")
    assert "stool0" in (tmp_path / "charts/fit.csv").read_text()
    (tmp_path / "charts/fit.png").unlink()
    run("bench", "redraw", "--out", tmp_path / "charts")
    assert str(tmp_path / "charts/fit.csv") in capsys.readouterr().out
    for name, method in ablations.ABLATIONS.items():
        monkeypatch.setitem(ablations.ABLATIONS, name, method._replace(settings=PRESETS["normal"]))
    run("bench", "ablations", *words)
    assert "| full |" in capsys.readouterr().out
    assert {path.name for path in (tmp_path / "charts").iterdir()} == {
        *(f"{name}.{kind}" for name in ("ablations", "fit", "robustness") for kind in ("csv", "md", "png")),
    }


@pytest.mark.parametrize("margin, said", [(-9.0, "doubtful"), (9.0, "")])
def test_a_low_confidence_is_said_in_words(margin, said, file, model, tmp_path, capsys, monkeypatch):
    camera, codes = model.camera(0.3, 0.3), model.codes[0]
    runner_up = RunnerUp((model.camera(3.4, 0.3),), 0.5)
    step = FitStep(1, 1, 0, 0.4, 30.0, 0.1, (camera,), codes, runner_up=runner_up, margin=margin, uncertainty=1.5)
    drawing = Image.new("RGB", (64, 64), "white")
    drawing.paste((200, 30, 30), (20, 14, 44, 52))
    drawing.save(tmp_path / "a.png")
    photo = Photo(torch.ones(8, 8, 3), torch.ones(8, 8, dtype=torch.bool))
    monkeypatch.setattr(fitting, "prepare_photo", lambda *_: photo)
    monkeypatch.setattr(fits, "fit", lambda *_: iter([step]))
    monkeypatch.setattr(fitting, "guess_category", lambda *_: {})
    run("fit", tmp_path / "a.png", "--model", file)
    printed = capsys.readouterr()
    assert said in printed.err
    assert bool(printed.err) == bool(said)
    found = json.loads(printed.out)
    place = {"azimuth": 194.8057, "elevation": 17.1887, "distance": 2.0, "focal": 1.025}
    assert found["runner_up"] == place | {"loss": 0.5}
    assert found["confidence"] == pytest.approx(step.confidence, abs=1e-3)
    assert found["uncertainty_deg"] == 1.5


def test_that_several_photos_have_no_confidence_is_said(file, model, tmp_path, capsys, monkeypatch):
    step = FitStep(1, 1, 0, 0.4, 30.0, 0.1, (model.camera(0.3, 0.3),) * 2, model.codes[0])
    drawing = Image.new("RGB", (64, 64), "white")
    drawing.paste((200, 30, 30), (20, 14, 44, 52))
    drawing.save(tmp_path / "a.png")
    photo = Photo(torch.ones(8, 8, 3), torch.ones(8, 8, dtype=torch.bool))
    monkeypatch.setattr(fitting, "prepare_photo", lambda *_: photo)
    monkeypatch.setattr(fits, "fit", lambda *_: iter([step]))
    monkeypatch.setattr(fitting, "guess_category", lambda *_: {})
    run("fit", tmp_path / "a.png", tmp_path / "a.png", "--model", file)
    printed = capsys.readouterr()
    assert json.loads(printed.out)["confidence"] is None
    assert "of several photos together" in printed.err


def test_a_box_is_in_pixels_of_the_upright_image(file, model, tmp_path, capsys, monkeypatch):
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    Image.new("RGB", (400, 200), "red").save(tmp_path / "a.jpg", exif=exif)
    given = []

    def cut(image, hints):
        given.append(hints.box)
        raise ValueError("enough")

    monkeypatch.setattr(fitting, "cut_out", cut)
    words = "fit", tmp_path / "a.jpg", "--model", file, "--box"
    for box in ("20,40,100,300", "20,40,300,300", "250,40,300,300", "20,40,100", "20,40,100,300 1,2,3,4"):
        with pytest.raises(SystemExit):
            run(*words, *box.split())
    assert given == [(0.1, 0.1, 0.5, 0.75), (0.1, 0.1, 1.0, 0.75)]
    printed = capsys.readouterr().err
    assert "no inside within the image of 200x400 px" in printed
    assert "a box is four numbers X0,Y0,X1,Y1, not '20,40,100'" in printed
    assert "1 images need as many boxes, got 2" in printed


def test_a_point_or_a_mask_says_where_the_object_is(file, tmp_path, capsys, monkeypatch):
    Image.new("RGB", (400, 200), "red").save(tmp_path / "a.png")
    mask = Image.new("L", (40, 20))
    mask.paste(255, (10, 5, 20, 15))
    mask.save(tmp_path / "mask.png")
    Image.new("L", (40, 20), 255).save(tmp_path / "white.png")
    given = []

    def cut(image, hints):
        given.append((hints and hints.points, image.getchannel("A").getbbox(), image.getchannel("A").getextrema()))
        raise ValueError("enough")

    monkeypatch.setattr(fitting, "cut_out", cut)
    words = "fit", tmp_path / "a.png", "--model", file
    mask_words = "--mask", tmp_path / "mask.png"
    for more in (
        ("--point", "100,50"),
        ("--point", "500,50"),
        ("--point", "1"),
        ("--point", "1,2", *mask_words),
        mask_words,
        ("--mask", tmp_path / "white.png"),
        (*mask_words, tmp_path / "mask.png"),
    ):
        with pytest.raises(SystemExit):
            run(*words, *more)
    (points, whole, opaque), (none, box, both) = given
    assert (points, whole, opaque) == (((0.25, 0.25),), (0, 0, 400, 200), (255, 255))
    assert none is None
    assert both == (0, 255)
    np.testing.assert_allclose(box, (100, 50, 200, 150), atol=10)
    printed = capsys.readouterr().err
    assert "outside the image of 400x200 px" in printed
    assert "a point is two numbers X,Y, not '1'" in printed
    assert "white.png: a mask is white on the object and black elsewhere" in printed
    assert "1 images need as many masks, got 2" in printed


def test_a_doubtful_cut_out_is_said(file, model, tmp_path, capsys, monkeypatch):
    """Nothing but noise: it is fitted all the same."""
    monkeypatch.setitem(sys.modules, "rembg", None)
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    Image.fromarray(noise).save(tmp_path / "a.png")
    pose = model.camera(np.radians(60), np.radians(20)).pose()
    (tmp_path / "pose.txt").write_text(" ".join(str(float(number)) for number in pose.flatten()))
    run("fit", tmp_path / "a.png", "--model", file, "--preset", "draft", "--pose", tmp_path / "pose.txt")
    printed = capsys.readouterr()
    assert "a.png: the cut-out is doubtful (0." in printed.err
    assert "azimuth" in json.loads(printed.out)


def test_what_is_kept_is_listed_and_cleared(tmp_path: Path, capsys, monkeypatch):
    monkeypatch.setenv("CODENERF_CACHE", str(tmp_path / "cache"))
    run("cache")
    assert capsys.readouterr().out == f"{tmp_path / 'cache'}\nnothing is kept\n"
    (tmp_path / "cache/view-banks").mkdir(parents=True)
    (tmp_path / "cache/view-banks/a.view-bank-1.safetensors").write_bytes(bytes(1_300_000))
    (tmp_path / "cache/mine.txt").touch()
    for words, end in (("cache",), ""), (("cache", "--clear"), "  removed"):
        run(*words)
        assert capsys.readouterr().out.endswith(f"\n1.3 MB  view-banks/a.view-bank-1.safetensors{end}\n")
    run("cache")
    assert "nothing is kept" in capsys.readouterr().out
    assert (tmp_path / "cache/mine.txt").exists()


def test_fit_ends_with_one_json_line(file: str, model: Model, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    run("render", "--model", file, "--object", 1, "--size", 32, "--out", tmp_path / "photo.png")
    camera = model.camera(np.radians(60), np.radians(20))
    (tmp_path / "pose.txt").write_text(" ".join(str(float(number)) for number in camera.pose().flatten()))
    run(
        "fit",
        tmp_path / "photo.png",
        "--pose",
        tmp_path / "pose.txt",
        "--model",
        file,
        "--out",
        tmp_path / "s.json",
        "--log",
        tmp_path / "steps.jsonl",
        "--explain",
        tmp_path / "why",
    )
    printed = json.loads(capsys.readouterr().out.strip().splitlines()[-1])
    assert list(printed)[:6] == ["azimuth", "elevation", "distance", "psnr", "seconds", "steps"]
    assert printed["focal"] == pytest.approx(model.focal / model.image_size, abs=1e-3)
    assert list(printed["seconds_by_part"]) == ["decode", "cut_out", "view_bank", "search"]
    assert 0 < printed["seconds_by_part"]["search"] < sum(printed["seconds_by_part"].values()) < printed["seconds"]
    assert printed["azimuth"] == pytest.approx(60, abs=1e-3)
    steps = [json.loads(line) for line in (tmp_path / "steps.jsonl").read_text().splitlines()]
    assert steps[-1]["psnr"] == printed["psnr"]
    page = (tmp_path / "why/index.html").read_text()
    assert "<h2>Terms of the objective</h2>" in page
    assert all((tmp_path / "why" / name).exists() for name in re.findall(r"<img src=(\S+)", page))
    assert Scene.load(tmp_path / "s.json", model).camera.elevation == pytest.approx(np.radians(20), abs=1e-5)
