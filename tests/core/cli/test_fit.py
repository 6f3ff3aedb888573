"""Fits of photos and videos, and what they print."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import ExifTags, Image

from core.cli import fit as fitting
from core.fitting import fit as fits
from core.fitting.fit import FitStep, RunnerUp
from core.metrics import rotation_error
from core.models.model import Model
from core.models.photo_detail import PhotoDetail, PhotoView
from core.models.scene import Scene
from core.photos.detector import Detection
from core.photos.photo import Photo
from core.photos.segmentation import CutOut, Hints
from tests.core.cli.conftest import draw, refused, run, write_pose
from tests.core.photos.test_clip_object import write_blocks


@pytest.fixture
def fit_ends(file: str, model: Model, monkeypatch: pytest.MonkeyPatch) -> Callable[..., FitStep]:
    """Return a function that sets the last step of the fit of ``a.png``, an image of a block, by its photos' number."""
    draw(Path("a.png"), (200, 30, 30))
    photo = Photo(torch.ones(8, 8, 3), torch.ones(8, 8, dtype=torch.bool))
    monkeypatch.setattr(fitting, "prepare_photo", lambda *_: photo)

    def end(photos: int = 1, **more: Any) -> FitStep:
        step = FitStep(1, 1, 0, 0.4, 30.0, 0.1, (model.camera(0.3, 0.3),) * photos, model[0], **more)
        monkeypatch.setattr(fits, "fit", lambda *_: iter([step]))
        return step

    return end


@pytest.fixture
def cuts(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Image.Image, Hints | None]]:
    """The images and hints of which cut-outs are made; none succeeds."""
    calls = []

    def cut(image: Image.Image, hints: Hints | None) -> None:
        calls.append((image, hints))
        raise ValueError("enough")

    monkeypatch.setattr(fitting, "cut_out", cut)
    return calls


@pytest.mark.parametrize("margin, warning", [(-9.0, "doubtful"), (9.0, "")])
def test_low_confidence_gives_a_warning(margin, warning, file, model, capsys, fit_ends):
    step = fit_ends(runner_up=RunnerUp((model.camera(3.4, 0.3),), 0.5), margin=margin, uncertainty=1.5)
    run(f"fit a.png --model {file}")
    printed = capsys.readouterr()
    assert warning in printed.err
    assert bool(printed.err) == bool(warning)
    result = json.loads(printed.out)
    camera = {"azimuth": 194.8057, "elevation": 17.1887, "distance": 2.0, "focal": 1.025}
    assert result["runner_up"] == camera | {"loss": 0.5}
    assert result["confidence"] == pytest.approx(step.confidence, abs=1e-3)
    assert result["uncertainty_deg"] == 1.5


def test_a_photo_of_another_object_is_left_out_by_name(file, capsys, fit_ends):
    fit_ends(2, margin=9.0, uncertainty=1.0, left_out=(1,), view_margins=(2.0, None))
    Path("b.png").write_bytes(Path("a.png").read_bytes())
    run(f"fit left:a.png b.png --model {file}")
    printed = capsys.readouterr()
    assert printed.err == "python -m core: b.png: this looks like another object, so it is left out\n"
    photos = json.loads(printed.out)["photos"]
    assert photos[1] is None and photos[0]["confidence"] > 0.9


def test_a_photo_joins_the_object_of_a_scene(file, model, capsys, monkeypatch, fit_ends):
    camera = model.camera(0.3, 0.3).resized(64, 64)
    step = replace(fit_ends(left_out=(1,)), cameras=(camera,) * 2)
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


def test_a_chair_and_a_car_are_not_fitted_as_one_object_unless_a_model_is_named(file, capsys, monkeypatch, fit_ends):
    Image.new("RGB", (65, 65), "white").save("b.png")
    cut_out = fitting.cut_out

    def cut_and_guess(image: Image.Image, hints: Hints | None) -> CutOut:
        if image.width == 65:
            return replace(cut_out(Image.open("a.png").convert("RGBA")), categories={"chairs": 0.1, "cars": 0.8})
        return replace(cut_out(image), categories={"chairs": 0.9, "cars": 0.05})

    fit_ends(3)
    monkeypatch.setattr(fitting, "cut_out", cut_and_guess)
    warning = "b.png: this looks like a car, the first image like a chair: the images of one fit show one object"
    advice = "Fit each object by itself, or choose one model with --model"
    assert refused(capsys, "fit a.png a.png b.png") == f"python -m core: {warning}. {advice}\n"
    run(f"fit a.png a.png b.png --model {file}")
    assert capsys.readouterr().err.splitlines()[0] == f"python -m core: {warning}"


def test_a_box_is_in_pixels_of_the_upright_image(file, capsys, cuts):
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    Image.new("RGB", (400, 200), "red").save("a.jpg", exif=exif)
    for box in ("20,40,100,300", "20,40,300,300", "250,40,300,300", "20,40,100", "20,40,100,300 1,2,3,4"):
        with pytest.raises(SystemExit):
            run(f"fit a.jpg --model {file} --box {box}")
    assert [hints.box for _, hints in cuts] == [(0.1, 0.1, 0.5, 0.75), (0.1, 0.1, 1.0, 0.75)]
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
    fit_ends()
    run(f"fit a.png --model {file} --object 2")
    assert passed_hints == [Hints(object=1)]
    assert capsys.readouterr().err == ""
    run(f"fit a.png --model {file}")
    assert "a.png: 2 objects are found: --object 2 fits the next one" in capsys.readouterr().err


def test_a_video_is_fitted_as_photos_of_one_object(file, capsys, monkeypatch, fit_ends):
    write_blocks(Path("walk.mp4"), [10, 20, 30, None])
    fit_ends(3)
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


def test_a_point_or_a_mask_selects_the_object(file, capsys, cuts):
    Image.new("RGB", (400, 200), "red").save("a.png")
    mask = Image.new("L", (40, 20))
    mask.paste(255, (10, 5, 20, 15))
    mask.save("mask.png")
    Image.new("L", (40, 20), 255).save("white.png")
    for option in (
        *("--point 100,50", "--point 500,50", "--point 1", "--point 1,2 --mask mask.png"),
        *("--mask mask.png", "--mask white.png", "--mask mask.png mask.png"),
    ):
        with pytest.raises(SystemExit):
            run(f"fit a.png --model {file} {option}")
    (whole_image, hints), (masked_image, no_hints) = cuts
    assert hints.points == ((0.25, 0.25),) and no_hints is None
    opaque, masked = (image.getchannel("A") for image in (whole_image, masked_image))
    assert opaque.getextrema() == (255, 255) and masked.getextrema() == (0, 255)
    np.testing.assert_allclose(masked.getbbox(), (100, 50, 200, 150), atol=10)
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
    write_pose(Path("pose.txt"), model)
    run(f"fit a.png --model {file} --preset draft --pose pose.txt")
    printed = capsys.readouterr()
    assert "a.png: the cut-out is doubtful (0." in printed.err
    assert "azimuth" in json.loads(printed.out)


def test_fit_ends_with_one_json_line(file: str, model: Model, capsys: pytest.CaptureFixture[str]):
    run(f"render --model {file} --object 1 --size 32 --out photo.png")
    write_pose(Path("pose.txt"), model)
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
