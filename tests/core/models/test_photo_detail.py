import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.geometry.camera import Camera
from core.models.model import Model
from core.models.photo_detail import MAX_BYTES, MAX_PHOTOS, Erasure, PhotoDetail, PhotoView
from core.models.scene import Scene, save_image

CAMERA = Camera(0.5, 0.2, 1.3, 60.0, 40, 30)
SCRATCH = Erasure(((0.25, 0.5), (0.75, 0.5)), 0.05)


def red_detail(model: Model) -> PhotoDetail:
    rgba = np.full((30, 40, 4), 255, np.uint8)
    rgba[10:20, 10:30] = 200, 30, 40, 255
    rgba[:5, :, 3] = 0
    mean = model.codes.mean
    view = replace(PhotoView.of(rgba, CAMERA), outline_margin=0.01)
    return PhotoDetail((view,), mean.shape, mean.texture, strength=0.75)


def test_compressed_pixels_are_similar_and_small(model: Model) -> None:
    pixels = red_detail(model).views[0].pixels()
    assert pixels.shape == (30, 40, 4)
    np.testing.assert_allclose(pixels[13:17, 14:26, :3].mean((0, 1)), (200, 30, 40), atol=12)
    assert (pixels[:4, :, 3] == 0).all() and (pixels[6:, :, 3] == 255).all()
    noise = np.random.default_rng(0).integers(0, 256, (1024, 1024, 4), np.uint8)
    noise[..., 3] = 255
    camera = CAMERA.resized(1024, 1024)
    assert len(PhotoView.of(noise, camera).image) <= MAX_BYTES


def test_a_scene_and_an_image_keep_the_detail(model: Model, tmp_path: Path) -> None:
    detail = replace(red_detail(model).erasing(0, (SCRATCH,)), strength=0.4, other_side="model")
    instance = model.mean.with_detail(detail)
    scene = Scene(instance, CAMERA)
    scene.save(tmp_path / "s.json")
    assert Scene.load(tmp_path / "s.json", model) == scene
    save_image(np.zeros((4, 4, 3), np.uint8), tmp_path / "p.png", scene)
    assert Scene.load(tmp_path / "p.png", model).instance.detail == instance.detail
    assert instance.with_detail(None) != instance


@pytest.mark.parametrize(
    "change",
    [
        {"image": "no base64!"},
        {"image": "aGVsbG8="},
        {"erased": [{"points": [[0.1, 0.2]], "radius": "wide"}]},
        {"outline_margin": -0.01},
        {"strength": 2},
        {"strength": "full"},
        {"shape": [1.0]},
        {"camera": {"azimuth": 0, "elevation": 0, "distance": 1.3, "focal": 60, "width": 41, "height": 30}},
    ],
)
def test_damaged_detail_is_refused_in_one_line(model: Model, tmp_path: Path, change: dict) -> None:
    instance = model.mean.with_detail(red_detail(model))
    content = json.loads(Scene(instance, CAMERA).to_json())
    stored = content["detail"]
    (stored if change.keys() & stored.keys() else stored["views"][0]).update(change)
    (tmp_path / "s.json").write_text(json.dumps(content))
    with pytest.raises(ValueError) as raised:
        Scene.load(tmp_path / "s.json", model)
    assert "\n" not in str(raised.value)


def test_masks_of_older_scenes_do_not_bound_the_object(model: Model) -> None:
    scene = Scene(model.mean.with_detail(red_detail(model)), CAMERA)
    content = json.loads(scene.to_json())
    del content["detail"]["views"][0]["outline_margin"]
    detail = Scene.from_json(json.dumps(content), model).instance.detail
    assert detail is not None and detail.views[0].outline_margin is None


def test_photo_detail_is_taken_with_the_shape(model: Model) -> None:
    plain = model[0]
    fitted = model[1].with_detail(red_detail(model))
    assert plain.taking("shape", fitted).detail is fitted.detail
    assert plain.taking("texture", fitted).detail is None
    assert fitted.taking("shape", plain).detail is None
    assert fitted.taking("texture", plain).detail is fitted.detail
    assert fitted.mixed(plain, 0.4, 1.0).detail is fitted.detail
    assert fitted.mixed(plain, 1.0, 0.0).detail is None
    assert fitted.mixed(plain, 0.0, 1.0).model is model


def test_an_erasure_covers_its_line_and_nothing_else(model: Model) -> None:
    view = red_detail(model).erasing(0, (SCRATCH,)).views[0]
    mask = view.kept(200, 150)
    assert mask.shape == (150, 200)
    assert not mask[75, 50:150].any()
    assert mask[:60].all() and mask[90:].all() and mask[:, :35].all() and mask[:, 165:].all()
    assert view != red_detail(model).views[0]


@pytest.mark.parametrize("count", [0, MAX_PHOTOS + 1])
def test_no_photos_and_too_many_are_refused(model: Model, count: int) -> None:
    detail = red_detail(model)
    with pytest.raises(ValueError, match=f"got {count}"):
        replace(detail, views=detail.views * count)
