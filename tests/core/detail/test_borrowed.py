"""Pictures of training objects on the tiny model, and those that ship."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from core.detail import borrowed
from core.detail.borrowed import ENDS, FOLDER, SIDE, end_camera, most_similar, pictured, read_pictures
from core.detail.maps import detail_maps
from core.detail.progressive import render_frame
from core.geometry.pixels import to_bytes
from core.gl.baking import bake
from core.models.library import load_model
from core.models.model import Instance, Model
from core.models.photo_detail import PhotoDetail, PhotoView
from core.rendering.reference import render_exact
from core.streams import run_to_end
from tests.conftest import offscreen
from tests.core.baked_reference import render_baked

PICTURES = sorted((FOLDER / "cars").glob("*.webp"))
FRONT, BEHIND = ENDS


@pytest.fixture
def model(tiny: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Model:
    """The tiny model, with striped pictures of its first object."""
    monkeypatch.setattr(borrowed, "FOLDER", tmp_path)
    model = replace(tiny, category="boxes")
    (tmp_path / "boxes").mkdir()
    rows = []
    for azimuth in ENDS:
        opacity = render_exact(model[0], end_camera(model, azimuth).resized(96, 96), 48).opacity
        opacity = torch.nn.functional.interpolate(opacity[None, None], SIDE)[0, 0]
        stripes = torch.where(torch.arange(SIDE)[:, None] // 12 % 2 == 0, 1.0, 0.0).expand(SIDE, SIDE)
        tiles = torch.zeros(SIDE, SIDE), stripes, opacity, torch.zeros(SIDE, SIDE)
        rows.append(torch.cat(tiles, 1))
    pixels = to_bytes(torch.cat(rows)[..., None].expand(-1, -1, 3))
    name = model.codes.objects[0].name
    Image.fromarray(pixels).save(tmp_path / "boxes" / f"{name}.webp", lossless=True)
    return model


@pytest.fixture
def instance(model: Model) -> Instance:
    """An object photographed from ahead."""
    camera = model.camera(FRONT, 0.2).resized(128, 128)
    image = render_exact(model[0], camera, 64)
    rgba = to_bytes(torch.cat((image.colour.clamp(0, 1), image.opacity[..., None]), -1))
    return model[0].with_detail(PhotoDetail.of((PhotoView.of(rgba, camera),), model[0].codes))


def test_the_end_that_no_photo_shows_is_borrowed(model: Model, instance: Instance) -> None:
    maps = run_to_end(detail_maps(instance))
    assert maps is not None and maps.borrowed == 1 and len(maps.photos) == 2
    behind = model.camera(BEHIND, 0.2).resized(96, 96)
    rendered = render_exact(instance, behind, 64)
    plain = replace(maps, photos=maps.photos[:1], borrowed=0)
    with_ends, sources = maps.added(rendered, behind)
    without_ends, sources_without_ends = plain.added(rendered, behind)
    assert (with_ends.colour - without_ends.colour).abs().amax() > 0.1
    assert torch.allclose(sources.mirrored, sources_without_ends.mirrored, atol=1e-5), (
        "borrowed colours count as the model's"
    )


def test_the_photos_own_view_stays(model: Model, instance: Instance) -> None:
    ahead = instance.detail.views[0].camera.resized(96, 96)
    maps = run_to_end(detail_maps(instance))
    rendered = render_exact(instance, ahead, 64)
    with_ends, _ = maps.added(rendered, ahead)
    plain, _ = replace(maps, photos=maps.photos[:1], borrowed=0).added(rendered, ahead)
    assert float((with_ends.colour - plain.colour).abs().mean()) < 0.001


def test_the_shader_shows_what_is_borrowed(model: Model, instance: Instance) -> None:
    *_, baked = bake(instance)
    assert baked is not None and baked.detail is not None and baked.detail.borrowed == 1
    behind = model.camera(BEHIND, 0.2).resized(96, 96)
    photos = replace(baked.detail, photos=baked.detail.photos[:1], borrowed=0)
    with offscreen((96, 96)) as pictures:
        drawn, bare = (pictures.draw(replace(baked, detail=maps), behind) / 255 for maps in (baked.detail, photos))
    change = np.abs(drawn - bare).mean()
    assert change > 0.005
    assert np.abs(drawn - render_baked(baked, behind).colour.numpy()).mean() < change / 4


def test_only_the_mirrored_side_borrows(instance: Instance) -> None:
    maps = run_to_end(detail_maps(instance.with_detail(replace(instance.detail, other_side="model"))))
    assert maps is not None and maps.borrowed == 0


def test_models_without_pictures_borrow_nothing(tiny: Model, instance: Instance) -> None:
    assert not pictured(tiny)
    maps = run_to_end(detail_maps(Instance(tiny, instance.codes)))
    assert maps is not None and maps.borrowed == 0
    assert render_frame(Instance(tiny, instance.codes), tiny.camera(BEHIND, 0.2).resized(32, 32)).final


@pytest.mark.parametrize("path", PICTURES, ids=lambda path: path.stem)
def test_shipped_pictures_are_credited_and_fit(path: Path) -> None:
    assert f"| {path.stem} |" in (FOLDER.parent / "CREDITS.md").read_text()
    assert path.stat().st_size < 40_000
    for picture in read_pictures(path):
        assert picture.colour.shape == (3, SIDE, SIDE)
        assert 0.02 < float(picture.opacity.mean()) < 0.9 and float(picture.paint.amax()) > 0.5


def test_a_training_object_is_most_similar_to_itself() -> None:
    cars = load_model("cars")
    pictures = pictured(cars)
    assert len(pictures) == len(PICTURES)
    number = list(pictures)[7]
    assert most_similar(cars[number], pictures) == number


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.webp"
    Image.fromarray(np.zeros((8, 8, 3), np.uint8)).save(path)
    with pytest.raises(ValueError, match=r"other\.webp"):
        read_pictures(path)
