"""Images, videos, meshes and pages of objects."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from core.__main__ import main
from core.editing.words import direction_words
from core.models.library import load_model
from core.models.model import Model
from core.models.photo_detail import PhotoDetail, PhotoView
from core.models.scene import Scene
from tests.core.cli.conftest import refused, run
from tests.core.tiny import tiny_model

pytestmark = pytest.mark.usefixtures("here")


def pixels(name: str) -> np.ndarray:
    with Image.open(name) as image:
        return np.asarray(image).astype(int)


def test_render_draws_objects_scenes_and_the_mean_fast_or_exactly(file: str, model: Model):
    view = "--azimuth 30 --elevation 10 --distance 2"
    run(f"render --model {file} --object 2 {view} --size 24 --out a.png")
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


def test_scenes_of_one_shape_are_variants_of_a_mesh_and_of_a_page(tiny_file: str, capsys: pytest.CaptureFixture[str]):
    scene = f"--model {tiny_file} --object 1 --size 16"
    run(f"render {scene} --out plain.png")
    run(f"render {scene} --paint c03028 --dimensions cm --out red.png")
    run(f"render {scene} --size-cm 60x58x92 --out wide.png")
    mesh = f"mesh --model {tiny_file} --scene plain.png --resolution 24 --texture 64"
    run(f"{mesh} --variants red.png --out a.glb")
    content = Path("a.glb").read_bytes()
    assert b'"variants": [{"name": "plain"}, {"name": "red"}]' in content and b"baseColorTexture" in content
    assert "wide has another shape" in refused(capsys, f"{mesh} --variants red.png wide.png --out b.glb")
    assert "two variants are named red" in refused(capsys, f"{mesh} --variants red.png red.png --out b.glb")
    run(f"page --model {tiny_file} --scene plain.png --variants red.png --dimensions in --ar --out a.html")
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


def bounds(name: str) -> np.ndarray:
    """Lowest and highest corner of a mesh, glTF axes, m."""
    return trimesh.load_scene(name, process=False).bounds


def test_legs_in_centimetres_are_those_of_the_mesh_and_of_pictures(capsys: pytest.CaptureFixture[str]):
    options = "--object 999 --resolution 24"
    run(f"mesh {options} --legs-cm 50 --out tall.glb")
    run(f"mesh {options} --size-cm 60x58x92 --legs-cm 50 --out split.glb")
    np.testing.assert_allclose(np.ptp(bounds("split.glb"), 0), (0.60, 0.92, 0.58), atol=1e-3)
    assert 0.95 < np.ptp(bounds("tall.glb"), 0)[1] < 1.05  # 90 cm, with legs of 40 cm
    run("render --object 999 --legs-cm 50 --size 32 --out tall.png")
    run("mesh --scene tall.png --resolution 24 --out again.glb")
    np.testing.assert_allclose(bounds("again.glb"), bounds("tall.glb"), atol=2e-3)
    for bad in ("--legs-cm 0", "--legs-cm nan", "--roof-cm 50", "--legs-cm 4000", "--model cars --legs-cm 50"):
        assert bad.split()[-2][2:6] in refused(capsys, f"mesh {options} {bad} --out a.glb")


def test_objects_are_edited_by_words_and_painted(tiny_file: str):
    options = f"--model {tiny_file} --object 1 --size 48"
    run(f"render {options} --out a.png")
    *_, words = direction_words(tiny_model())
    name = next(word for word in (*words["texture"], *words["shape"]) if word)
    main([*f"render {options} --out edited.png --edit".split(), f"{name}=1.5"])
    run(f"render {options} --paint #c03028 --out painted.png")
    plain, edited, painted = map(pixels, ("a.png", "edited.png", "painted.png"))
    assert (plain != edited).any() and (plain != painted).any()
    run(f"page --model {tiny_file} --object 1 --paint #c03028 --name Stool --out a.html")
    assert "<title>Stool</title>" in Path("a.html").read_text()
