"""The command line as a person types it, in this process."""

import json
import math
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from PIL import ExifTags, Image

from core.__main__ import main
from core.cli import fit as fitting
from core.editing.words import direction_words
from core.fitting import fit as fits
from core.fitting.fit import PRESETS, FitSettings, FitStep, RunnerUp
from core.lab.datasets.srn import read_dataset, write_manifest, write_object
from core.metrics import rotation_error
from core.models.library import load_model
from core.models.model import Model
from core.models.photo_detail import PhotoDetail, PhotoView
from core.models.scene import Scene
from core.photos.detector import Detection
from core.photos.photo import Photo
from core.photos.segmentation import CutOut, Hints
from tests.core.lab.datasets.test_glb_objects import write_folder
from tests.core.lab.evaluation.test_protocol import views_of
from tests.core.photos.test_clip_object import write_blocks
from tests.core.tiny import SIDE, tiny_model


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PRESETS, "normal", FitSettings(steps=40, rays=96, samples=20))


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands are typed in a folder of their own."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def file(model: Model) -> str:
    model.save(Path("m.safetensors"))
    return "m.safetensors"


def run(words: str) -> None:
    main(words.split())


def refused(capsys: pytest.CaptureFixture[str], words: str) -> str:
    """Return the message of a wrong call; check that it is one line, with status 2 and nothing on stdout."""
    with pytest.raises(SystemExit) as stopped:
        run(words)
    printed = capsys.readouterr()
    assert stopped.value.code == 2
    assert printed.out == ""
    assert len(printed.err.strip().splitlines()) == 1
    assert "Traceback" not in printed.err
    return printed.err


def pixels(name: str) -> np.ndarray:
    with Image.open(name) as image:
        return np.asarray(image).astype(int)


def write_pose(model: Model) -> None:
    pose = model.camera(np.radians(60), np.radians(20)).pose()
    Path("pose.txt").write_text(" ".join(map(str, pose.flatten().tolist())))


def test_render_draws_objects_scenes_and_the_mean_fast_or_exactly(file: str, model: Model):
    place = "--azimuth 30 --elevation 10 --distance 2"
    run(f"render --model {file} --object 2 {place} --size 24 --out a.png")
    Scene(model[2], model.camera(np.radians(30), np.radians(10))).save(Path("s.json"))
    run(f"render --model {file} --scene s.json --size 24 --out b.png")
    run(f"render --model {file} --scene s.json --size 24 --out exact.png --exact")
    run(f"render --model {file} --size 36x24 --out mean.png")
    a, b, exact, mean = map(pixels, ("a.png", "b.png", "exact.png", "mean.png"))
    assert a.shape == (24, 24, 3)
    assert np.array_equal(a, b)
    assert 0 < np.abs(b - exact).mean() < 4
    assert mean.shape == (24, 36, 3)
    assert not np.array_equal(a, mean[:, 6:-6])


def test_a_turntable_becomes_another_object_and_turns_back(file: str):
    model = load_model(file)
    Scene(model[1], model.camera(2.0, 0.6)).save(Path("there.json"))
    options = "--object 0 --distance 2 --size 24 --frames 4 --fps 24 --transparent --exact"
    for to, out in (("1", "t"), ("there.json", "s")):
        run(f"turntable --model {file} {options} --to {to} --out {out}.frames")
    run(f"render --model {file} --object 1 --azimuth 240 --distance 2 --size 24 --out there.png")
    assert len(list(Path("t.frames").iterdir())) == 4
    with Image.open("t.frames/00002.png") as halfway:
        white = Image.new("RGBA", halfway.size, "white")
        white.alpha_composite(halfway)
    assert np.abs(np.asarray(white.convert("RGB")).astype(int) - pixels("there.png")).max() <= 3
    assert Path("s.frames/00002.png").read_bytes() == Path("t.frames/00002.png").read_bytes()


def test_a_swing_starts_at_the_photos_camera_not_at_the_last_view(file: str, capsys: pytest.CaptureFixture[str]):
    model = load_model(file)
    photo_camera = model.camera(0.3, 0.1).resized(24, 24)
    detail = PhotoDetail.of((PhotoView.of(np.full((24, 24, 4), 255, np.uint8), photo_camera),), model.codes[0])
    Scene(model[0].with_detail(detail), model.camera(2.0, 0.6)).save(Path("s.json"))
    options = f"--model {file} --scene s.json --distance 1.5 --size 24"
    run(f"turntable {options} --frames 4 --exact --swing --out t.frames")
    for number, angle in enumerate((0, 70, 0, -70)):
        azimuth = math.degrees(0.3) + angle
        run(f"render {options} --azimuth {azimuth} --elevation {math.degrees(0.1)} --out a.png")
        assert np.abs(pixels(f"t.frames/{number:05}.png").astype(int) - pixels("a.png")).max() <= 3
    with pytest.raises(SystemExit):
        run(f"turntable {options} --swing --to 1 --out t.gif")
    assert "not allowed with" in capsys.readouterr().err


def test_a_gif_keeps_the_frames_that_browsers_show(file: str, capsys: pytest.CaptureFixture[str]):
    run(f"turntable --model {file} --frames 12 --fps 60 --size 16 --out t.gif")
    assert "t.gif: browsers show at most 50 frames a second of it, so 10 of 12 are kept" in capsys.readouterr().err
    run(f"turntable --model {file} --frames 12 --fps 60 --size 16 --out t.webp")
    assert "browsers" not in capsys.readouterr().err


def test_mesh_writes_the_object():
    tiny_model().save(Path("m.safetensors"))
    run("mesh --model m.safetensors --object 1 --resolution 24 --out a.ply")
    assert Path("a.ply").read_bytes().startswith(b"ply")
    run("mesh --model m.safetensors --object 1 --resolution 24 --texture 64 --metres 0.9 --out a.glb")
    assert b"baseColorTexture" in Path("a.glb").read_bytes()
    run("mesh --model m.safetensors --object 1 --resolution 24 --texture 64 --out a.usdz")
    assert Path("a.usdz").read_bytes().startswith(b"PK")


def test_scenes_of_one_shape_are_variants_of_a_mesh_and_of_a_page(capsys: pytest.CaptureFixture[str]):
    tiny_model().save(Path("m.safetensors"))
    scene = "--model m.safetensors --object 1 --size 16"
    run(f"render {scene} --out plain.png")
    run(f"render {scene} --paint c03028 --dimensions cm --out red.png")
    run(f"render {scene} --size-cm 60x58x92 --out wide.png")
    mesh = "mesh --model m.safetensors --scene plain.png --resolution 24 --texture 64"
    run(f"{mesh} --variants red.png --out a.glb")
    assert b'"variants": [{"name": "plain"}, {"name": "red"}]' in Path("a.glb").read_bytes()
    assert "wide has another shape" in refused(capsys, f"{mesh} --variants red.png wide.png --out b.glb")
    assert "two variants are named red" in refused(capsys, f"{mesh} --variants red.png red.png --out b.glb")
    run("page --model m.safetensors --scene plain.png --variants red.png --dimensions in --ar --out a.html")
    text = Path("a.html").read_text()
    assert '"name":"red","colour":"#' in text and ' in"' in text and '"glb":"a.room.glb"' in text


def test_a_mesh_stands_on_the_ground_in_natural_size_and_may_be_too_large_to_print(capsys: pytest.CaptureFixture[str]):
    replace(tiny_model(), metres=1.5).save(Path("m.safetensors"))
    run("mesh --model m.safetensors --object 1 --resolution 24 --out a.stl")
    low, high = trimesh.load_mesh("a.stl").bounds
    assert low[2] == pytest.approx(0, abs=1) and max(high - low) == pytest.approx(1500, abs=1)
    assert "a.stl: 1.5 m long, larger than any printer" in capsys.readouterr().err
    run("mesh --model m.safetensors --object 1 --resolution 24 --size-cm 90x90x120 --out a.3mf")
    assert "a.3mf: 1.2 m long" in capsys.readouterr().err
    for options in ("--metres 0.2 --out a.stl", "--out a.glb"):
        run(f"mesh --model m.safetensors --object 1 --resolution 24 {options}")
        assert "printer" not in capsys.readouterr().err


def test_a_size_in_centimetres_is_that_of_the_mesh_and_of_pictures():
    tiny_model().save(Path("m.safetensors"))
    options = "--model m.safetensors --object 1"
    run(f"mesh {options} --size-cm 60x58x92 --resolution 24 --out a.glb")
    low, high = trimesh.load_scene("a.glb", process=False).bounds
    np.testing.assert_allclose(high - low, (0.60, 0.92, 0.58), atol=1e-3)
    run(f"render {options} --size 48 --out natural.png")
    run(f"render {options} --size 48 --size-cm 60x58x120 --out sized.png")
    assert (pixels("natural.png") != pixels("sized.png")).any()
    run("mesh --model m.safetensors --scene sized.png --resolution 24 --out b.glb")
    low, high = trimesh.load_scene("b.glb", process=False).bounds
    np.testing.assert_allclose(high - low, (0.60, 1.20, 0.58), atol=1e-3)


def test_legs_in_centimetres_are_those_of_the_mesh_and_of_pictures(capsys: pytest.CaptureFixture[str]):
    options = "--object 999 --resolution 24"
    run(f"mesh {options} --legs-cm 50 --out tall.glb")
    run(f"mesh {options} --size-cm 60x58x92 --legs-cm 50 --out split.glb")
    low, high = trimesh.load_scene("split.glb", process=False).bounds
    np.testing.assert_allclose(high - low, (0.60, 0.92, 0.58), atol=1e-3)
    low, high = trimesh.load_scene("tall.glb", process=False).bounds
    assert 0.95 < (high - low)[1] < 1.05  # 90 cm, with legs of 40 cm
    run("render --object 999 --legs-cm 50 --size 32 --out tall.png")
    run("mesh --scene tall.png --resolution 24 --out again.glb")
    np.testing.assert_allclose(trimesh.load_scene("again.glb", process=False).bounds, (low, high), atol=2e-3)
    for bad in ("--legs-cm 0", "--legs-cm nan", "--roof-cm 50", "--legs-cm 4000", "--model cars --legs-cm 50"):
        assert bad.split()[-2][2:6] in refused(capsys, f"mesh {options} {bad} --out a.glb")


@pytest.mark.parametrize("size", ["0x58x92", "60x-5x92", "nanx58x92", "60x58", "1x2x3x4x5", "1e6x1e6x1e6", "60x58x5e4"])
def test_other_sizes_are_refused(size: str, capsys: pytest.CaptureFixture[str]):
    tiny_model().save(Path("m.safetensors"))
    assert "cm" in refused(capsys, f"render --model m.safetensors --size-cm {size} --out a.png")


def test_objects_are_edited_by_words_and_painted():
    tiny_model().save(Path("m.safetensors"))
    options = "--model m.safetensors --object 1 --size 48"
    run(f"render {options} --out a.png")
    name = named_direction()
    main([*f"render {options} --out edited.png --edit".split(), f"{name}=1.5"])
    run(f"render {options} --paint #c03028 --out painted.png")
    plain, edited, painted = map(pixels, ("a.png", "edited.png", "painted.png"))
    assert (plain != edited).any() and (plain != painted).any()
    run("page --model m.safetensors --object 1 --paint #c03028 --name Stool --out a.html")
    assert "<title>Stool</title>" in Path("a.html").read_text()


def named_direction() -> str:
    """Return a name of one of the tiny model's directions."""
    *_, words = direction_words(tiny_model())
    return next(word for word in (*words["texture"], *words["shape"]) if word)


def test_convert_writes_a_model_file(shared: Path, capsys: pytest.CaptureFixture[str]):
    source = shared / "upstream/srncars500"
    shutil.copy(source / "models.pth", "models.pth")
    run(f"convert models.pth --config {source / 'hpam.json'} --out c.safetensors")
    assert "24, 142, 149" in capsys.readouterr().out
    assert len(load_model("c.safetensors").codes) == 500


def write_stools() -> None:
    """The tiny model, and a dataset of three of its objects, each seen three times."""
    tiny_model().save(Path("m.safetensors"))
    for index in range(3):
        write_object(Path("d"), views_of(tiny_model(), index, 3))


def write_nerf_stools(scale: float) -> None:
    """The tiny model, and two of its objects in NeRF's layout and units of ``scale``."""
    tiny_model().save(Path("m.safetensors"))
    for index in range(2):
        views = views_of(tiny_model(), index, 3)
        frames = []
        Path(f"d/stool{index}/train").mkdir(parents=True)
        for number, camera in enumerate(views.cameras):
            alpha = Image.fromarray(views.masks[number].astype(np.uint8) * 255)
            image = Image.fromarray(views.images[number])
            image.putalpha(alpha)
            image.save(f"d/stool{index}/train/r_{number}.png")
            matrix = camera.pose().numpy() @ np.diag([1.0, -1.0, -1.0, 1.0])
            matrix[:3, 3] /= scale
            frames.append({"file_path": f"./train/r_{number}", "transform_matrix": matrix.tolist()})
        angle = 2 * math.atan(camera.width / 2 / camera.focal)
        transforms = json.dumps({"camera_angle_x": angle, "frames": frames})
        Path(f"d/stool{index}/transforms_train.json").write_text(transforms)


@pytest.mark.usefixtures("quick")
def test_nerf_folders_are_fitted_evaluated_and_trained_on(capsys: pytest.CaptureFixture[str]):
    write_nerf_stools(0.3)
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


@pytest.mark.usefixtures("quick")
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


@pytest.mark.usefixtures("quick")
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


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("render --model {file} --edit taller --out a.png", "edits are NAME=X"),
        ("render --model {file} --edit roof=1 --out a.png", "no direction 'roof'"),
        ("render --model {file} --paint red --out a.png", "a paint is #rrggbb"),
        ("render --out a.png --model boats", "boats"),
        ("render --out a.png --model {file} --object 9", "0 to 5"),
        ("render --out a.png --elevation 120", "from -90 to 90 degrees"),
        ("render --out a.png --azimuth 1e30", "from -3600 to 3600 degrees"),
        *((f"render --out a.png --distance {words}", "0.05 to 100 scene units") for words in ("-1", "1e30", "1e-30")),
        *((f"render --out a.png --edit taller={words}", "from -10 to 10 standard") for words in ("1e30", "-inf")),
        ("render --out a.png --threads 1000000", "1 to 1024"),
        ("turntable --out a.mp4 --frames 1000000000", "1 to 100000"),
        ("turntable --out a.mp4 --fps 1e30", "1 to 100"),
        ("mesh --out a.ply --metres 1e30", "0.0001 to 1e+06"),
        ("mesh --out a.ply --metres 1e-30", "0.0001 to 1e+06"),
        ("mesh --out a.ply --model {file} --texture 1e9", "16 to 8192"),
        ("fit a.png --seed 99999999999999999999", "0 to 4294967295"),
        ("fit a.png --box 0,0,nan,9", "four numbers"),
        ("fit a.png --point inf,9", "two numbers"),
        ("train d --out m.safetensors --latent 4 1e30", "1 to 8192"),
        ("train d --out m.safetensors --shares nan", "1e-06 to 1e+06"),
        ("dataset meshes . --out d --category chairs --variants -1", "0 to 10000"),
        ("evaluate d --input-views -1", "from 0"),
        ("evaluate d --input-views 1e30", "from 0"),
        ("render --out gone/a.png --model {file}", "folder"),
        ("render --out . --model {file}", "it is a folder"),
        ("render --out a.xyz --model {file} --size 8", "must end in"),
        ("render --out a.png --size none", "--size"),
        ("render --out a.png --size 8x0", "854x480"),
        ("turntable --out t.mp4 --model {file} --size 1", "at least 2 px"),
        ("render --out a.png --azimuth nan", "--azimuth"),
        ("turntable --out t.avi --model {file}", "mp4"),
        ("turntable --out t.mp4 --quality 101", "1 to 100"),
        ("mesh --out a.dae --model {file}", "glb"),
        ("convert {file} --out a.safetensors", "hpam.json"),
        ("convert {file} --config {file} --out a.pth", "safetensors"),
        ("evaluate gone --model {file}", "no such dataset"),
        ("evaluate . --model {file} --input-views 64,,1", "--input-views"),
        ("evaluate . --model {file} --input-views 3,3", "distinct"),
        ("fit gone.png --model {file}", "gone.png"),
        ("fit {file} --model {file}", "m.safetensors"),
        ("fit a.png --out .", "must end in .json"),
        ("fit a.png --log .", "it is a folder"),
        ("fit a.png --log a.png", "cannot write a.png: this command needs it"),
        ("fit a.png --out ./s.json --log s.json", "cannot write s.json: this command needs it"),
        ("fit a.png --mask s.json --out s.json", "cannot write s.json: this command needs it"),
        ("fit a.png --explain {file}", "it is not a folder"),
        ("fit a.png --out gone/a.json", "no folder"),
        ("fit a.png b.png --model {file} --pose p.txt", "as many poses"),
        ("fit a.png --preset best", "paper"),
        ("fit a.png --preset paper --estimate-focal", "focal length"),
        ("fit a.png --pose a.txt --estimate-focal", "--pose gives them"),
        ("bench all --dataset gone", "no such dataset"),
        ("bench page --out gone", "no CSV file"),
        ("bench all --quick --minutes 0 --out gone", "no CSV file"),
        ("train . --out x.safetensors", "no object folders"),
        ("train . --init {file} --width 32 --out x.safetensors", "omit --width"),
        ("dataset meshes . --out d --category chairs", "index.json"),
        ("dataset pack . --out d.zip", "must end in .views"),
        ("dataset pack gone --out d.views", "no such dataset"),
        ("nonsense", "nonsense"),
        ("", "COMMAND"),
    ],
)
def test_wrong_input_is_named_in_one_line(words: str, message: str, file: str, capsys: pytest.CaptureFixture[str]):
    assert message in refused(capsys, words.format(file=file))


@pytest.mark.usefixtures("rasteriser")
def test_dataset_train_and_render_from_nothing():
    """Meshes become a dataset, the dataset a model; and training resumes."""
    write_folder(Path(), ["one", "two"])
    run("dataset meshes . --category chairs --views 6 --size 24 --out d")
    objects = read_dataset(Path("d")).objects
    assert len(objects) == 2
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
    before = load_model("n.safetensors")
    assert extended.field.config == before.field.config
    weights = extended.viewpoint_classifier.state_dict()
    former_weights = before.viewpoint_classifier.state_dict()
    assert all(torch.equal(weights[name], former_weights[name]) for name in former_weights)
    run("train-viewpoint d --model n.safetensors --steps 1 --out looks.safetensors")
    looks = load_model("looks.safetensors")
    assert looks.fingerprint == before.fingerprint
    assert looks.viewpoint_classifier is not None


def test_train_parts_adds_a_part_head(capsys):
    run("train-parts --model cars --labels cars --objects 2 --out parts.safetensors")
    assert "body, wheels, glass: " in capsys.readouterr().out
    model = load_model("parts.safetensors")
    assert model.fingerprint == load_model("cars").fingerprint
    assert model.part_head.names == ("body", "wheels", "glass")


@pytest.fixture
def fit_ends(monkeypatch: pytest.MonkeyPatch) -> Callable[[FitStep], None]:
    """Return a function that sets the last step of the fit of ``a.png``, an image of a box."""
    drawing = Image.new("RGB", (64, 64), "white")
    drawing.paste((200, 30, 30), (20, 14, 44, 52))
    drawing.save("a.png")
    photo = Photo(torch.ones(8, 8, 3), torch.ones(8, 8, dtype=torch.bool))
    monkeypatch.setattr(fitting, "prepare_photo", lambda *_: photo)
    return lambda step: monkeypatch.setattr(fits, "fit", lambda *_: iter([step]))


@pytest.mark.parametrize("margin, warning", [(-9.0, "doubtful"), (9.0, "")])
def test_low_confidence_gives_a_warning(margin, warning, file, model, capsys, fit_ends):
    runner_up = RunnerUp((model.camera(3.4, 0.3),), 0.5)
    cameras = (model.camera(0.3, 0.3),)
    step = FitStep(1, 1, 0, 0.4, 30.0, 0.1, cameras, model[0], runner_up=runner_up, margin=margin, uncertainty=1.5)
    fit_ends(step)
    run(f"fit a.png --model {file}")
    printed = capsys.readouterr()
    assert warning in printed.err
    assert bool(printed.err) == bool(warning)
    result = json.loads(printed.out)
    place = {"azimuth": 194.8057, "elevation": 17.1887, "distance": 2.0, "focal": 1.025}
    assert result["runner_up"] == place | {"loss": 0.5}
    assert result["confidence"] == pytest.approx(step.confidence, abs=1e-3)
    assert result["uncertainty_deg"] == 1.5


def test_a_photo_of_another_object_is_left_out_by_name(file, model, capsys, fit_ends, tmp_path):
    cameras = (model.camera(0.3, 0.3),) * 2
    step = FitStep(1, 1, 0, 0.4, 30.0, 0.1, cameras, model[0], margin=9.0, uncertainty=1.0, left_out=(1,))
    fit_ends(replace(step, view_margins=(2.0, None)))
    Path("b.png").write_bytes(Path("a.png").read_bytes())
    run(f"fit left:a.png b.png --model {file}")
    printed = capsys.readouterr()
    assert printed.err == "python -m core: b.png: this looks like another object, so it is left out\n"
    photos = json.loads(printed.out)["photos"]
    assert photos[1] is None and photos[0]["confidence"] > 0.9


def test_a_photo_joins_the_object_of_a_scene(file, model, capsys, monkeypatch, fit_ends):
    camera = model.camera(0.3, 0.3).resized(64, 64)
    fit_ends(FitStep(1, 1, 0, 0.4, 30.0, 0.1, (camera,) * 2, model[0], left_out=(1,)))
    step = next(fits.fit(model, None))
    jobs = []
    monkeypatch.setattr(fits, "fit", lambda model, job: iter([jobs.append(job) or step]))
    Scene(model[0], camera).save(Path("plain.json"))
    assert "the object has no photos" in refused(capsys, f"fit a.png --resume plain.json --model {file}")
    view = PhotoView.of(np.full((64, 64, 4), 200, np.uint8), camera)
    Scene(model[0].with_detail(PhotoDetail.of((view,), model[0].codes)), camera).save(Path("s.json"))
    run(f"fit a.png --resume s.json --model {file} --out s.json")
    assert jobs[0].added == range(1, 2) and rotation_error(jobs[0].resume_from.cameras[0], camera) < 1e-3
    printed = capsys.readouterr()
    assert printed.err == "python -m core: a.png: this looks like another object, so it is left out\n"
    assert len(json.loads(printed.out)["photos"]) == 2


def test_a_chair_and_a_car_are_not_fitted_as_one_object_unless_a_model_is_named(
    file, model, capsys, monkeypatch, fit_ends
):
    Image.new("RGB", (65, 65), "white").save("b.png")
    cut_out = fitting.cut_out

    def cut_and_guess(image: Image.Image, hints: Hints | None) -> CutOut:
        if image.width == 65:
            return replace(cut_out(Image.open("a.png").convert("RGBA")), categories={"chairs": 0.1, "cars": 0.8})
        return replace(cut_out(image), categories={"chairs": 0.9, "cars": 0.05})

    fit_ends(FitStep(1, 1, 0, 0.4, 30.0, 0.1, (model.camera(0.3, 0.3),) * 3, model[0]))
    monkeypatch.setattr(fitting, "cut_out", cut_and_guess)
    warning = "b.png: this looks like a car, the first image like a chair: the images of one fit show one object"
    advice = "Fit each object by itself, or choose one model with --model"
    assert refused(capsys, "fit a.png a.png b.png") == f"python -m core: {warning}. {advice}\n"
    run(f"fit a.png a.png b.png --model {file}")
    assert capsys.readouterr().err.splitlines()[0] == f"python -m core: {warning}"


def test_a_box_is_in_pixels_of_the_upright_image(file, capsys, monkeypatch):
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    Image.new("RGB", (400, 200), "red").save("a.jpg", exif=exif)
    boxes = []

    def cut(image, hints):
        boxes.append(hints.box)
        raise ValueError("enough")

    monkeypatch.setattr(fitting, "cut_out", cut)
    for box in ("20,40,100,300", "20,40,300,300", "250,40,300,300", "20,40,100", "20,40,100,300 1,2,3,4"):
        with pytest.raises(SystemExit):
            run(f"fit a.jpg --model {file} --box {box}")
    assert boxes == [(0.1, 0.1, 0.5, 0.75), (0.1, 0.1, 1.0, 0.75)]
    printed = capsys.readouterr().err
    assert "the box around the object is empty or outside the image of 200x400 px" in printed
    assert "a box is four numbers X0,Y0,X1,Y1, not '20,40,100'" in printed
    assert "1 images need as many boxes, got 2" in printed


def test_a_number_selects_the_detection_and_a_second_object_is_mentioned(file, capsys, monkeypatch, fit_ends):
    passed_hints = []
    cut = fitting.cut_out(Image.open("a.png").convert("RGBA"))
    detections = tuple(Detection((0.2, 0.2, 0.6, 0.6), {"chairs": score, "cars": 0.0}) for score in (0.8, 0.7))

    def find(image, hints):
        passed_hints.append(hints)
        return replace(cut, confidence=0.8, detections=detections)

    monkeypatch.setattr(fitting, "cut_out", find)
    fit_ends(FitStep(1, 1, 0, 0.4, 30.0, 0.1, (load_model(file).camera(0.3, 0.3),), load_model(file)[0]))
    run(f"fit a.png --model {file} --object 2")
    assert passed_hints == [Hints(object=2)]
    assert capsys.readouterr().err == ""
    run(f"fit a.png --model {file}")
    assert "a.png: 2 objects are found: --object 2 fits the next one" in capsys.readouterr().err


def test_a_video_is_fitted_as_photos_of_one_object(file, model, capsys, monkeypatch, fit_ends):
    write_blocks(Path("walk.mp4"), [10, 20, 30, None])
    fit_ends(FitStep(1, 1, 0, 0.4, 30.0, 0.1, (model.camera(0.3, 0.3),) * 3, model[0]))
    job = fitting.FitJob
    monkeypatch.setattr(fitting, "FitJob", lambda photos, *rest: counts.append(len(photos)) or job(photos, *rest))
    counts = []
    run(f"fit walk.mp4 --frames 4 --model {file} --out scene.json")
    run(f"fit a.png walk.mp4 --frames 2 --model {file}")
    assert counts == [3, 3]
    printed = capsys.readouterr()
    assert "walk.mp4: 1 of 4 frames are left out: no object at 3." in printed.err
    assert "clip" in json.loads(printed.out.splitlines()[0])["seconds_by_part"]
    assert Path("scene.json").exists()
    assert "walk.mp4: --box is of photos" in refused(capsys, f"fit walk.mp4 --box 1,2,3,4 --model {file}")


def test_a_point_or_a_mask_selects_the_object(file, capsys, monkeypatch):
    Image.new("RGB", (400, 200), "red").save("a.png")
    mask = Image.new("L", (40, 20))
    mask.paste(255, (10, 5, 20, 15))
    mask.save("mask.png")
    Image.new("L", (40, 20), 255).save("white.png")
    calls = []

    def cut(image, hints):
        calls.append((hints and hints.points, image.getchannel("A").getbbox(), image.getchannel("A").getextrema()))
        raise ValueError("enough")

    monkeypatch.setattr(fitting, "cut_out", cut)
    for option in (
        *("--point 100,50", "--point 500,50", "--point 1", "--point 1,2 --mask mask.png"),
        *("--mask mask.png", "--mask white.png", "--mask mask.png mask.png"),
    ):
        with pytest.raises(SystemExit):
            run(f"fit a.png --model {file} {option}")
    (points, opaque_box, opacities), (no_points, box, masked_opacities) = calls
    assert (points, opaque_box, opacities) == (((0.25, 0.25),), (0, 0, 400, 200), (255, 255))
    assert no_points is None
    assert masked_opacities == (0, 255)
    np.testing.assert_allclose(box, (100, 50, 200, 150), atol=10)
    printed = capsys.readouterr().err
    assert "outside the image of 400x200 px" in printed
    assert "a point is two numbers X,Y, not '1'" in printed
    assert "white.png: the mask has 1 value (255); it must be white on the object, black elsewhere" in printed
    assert "1 images need as many masks, got 2" in printed


def test_doubtful_masks_give_a_warning(file, model, capsys, monkeypatch):
    """Noise has no object, but is fitted all the same."""
    monkeypatch.setattr("core.photos.candidates.predict_saliency", lambda _: None)
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    Image.fromarray(noise).save("a.png")
    write_pose(model)
    run(f"fit a.png --model {file} --preset draft --pose pose.txt")
    printed = capsys.readouterr()
    assert "a.png: the cut-out is doubtful (0." in printed.err
    assert "azimuth" in json.loads(printed.out)


def test_fit_ends_with_one_json_line(file: str, model: Model, capsys: pytest.CaptureFixture[str]):
    run(f"render --model {file} --object 1 --size 32 --out photo.png")
    write_pose(model)
    run(f"fit photo.png --pose pose.txt --model {file} --out s.json --log steps.jsonl --explain why")
    printed = json.loads(capsys.readouterr().out.strip().splitlines()[-1])
    assert list(printed)[:6] == ["azimuth", "elevation", "distance", "psnr", "seconds", "steps"]
    assert printed["focal"] == pytest.approx(model.focal / model.image_size, abs=1e-3)
    assert list(printed["seconds_by_part"]) == ["decode", "cut_out", "view_bank", "search"]
    assert 0 < printed["seconds_by_part"]["search"] < sum(printed["seconds_by_part"].values()) < printed["seconds"]
    assert printed["azimuth"] == pytest.approx(60, abs=1e-3)
    steps = [json.loads(line) for line in Path("steps.jsonl").read_text().splitlines()]
    assert steps[-1]["psnr"] == printed["psnr"]
    page = Path("why/index.html").read_text()
    assert "<td>result</td>" in page
    assert all(Path("why", name).exists() for name in re.findall(r"<img src=([\w.]+)", page))
    assert Scene.load(Path("s.json"), model).camera.elevation == pytest.approx(np.radians(20), abs=1e-5)
