"""The outline of a photo whose mask lacks the right third of a tiny model's object."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from core.export.mesh import extract_mesh
from core.geometry.camera import Camera
from core.geometry.pixels import to_bytes
from core.gl.baking import bake
from core.metrics import psnr
from core.models.model import Instance, Model
from core.models.photo_detail import PhotoDetail, PhotoView
from core.rendering.fast import clear_cache, render
from core.rendering.outline import FADED, coherence, outline
from core.rendering.reference import render_exact
from core.streams import run_to_end
from tests.core.baked_reference import render_baked

SIZE = 96
MARGIN = 0.03


@pytest.fixture(scope="module")
def camera(tiny: Model) -> Camera:
    return tiny.camera(1.1, 0.3).resized(SIZE, SIZE)


@pytest.fixture(scope="module")
def instance(tiny: Model, camera: Camera) -> Instance:
    """An object whose photo shows nothing of its right third."""
    rendered = render_exact(tiny[0], camera, 64)
    opacity = (rendered.opacity > 0.5).float()
    opacity[:, int(0.55 * SIZE) :] = 0
    rgba = to_bytes(torch.cat((rendered.colour.clamp(0, 1), opacity[..., None]), -1))
    view = replace(PhotoView.of(rgba, camera), outline_margin=MARGIN)
    detail = PhotoDetail((view,), tiny.codes[0].shape, tiny.codes[0].texture, other_side="model")
    return tiny[0].with_detail(detail)


def test_the_weight_of_a_point_follows_from_its_distance_to_the_mask(tiny: Model, instance: Instance) -> None:
    view = instance.detail.views[0]
    points = (2 * torch.rand(400, 3, generator=torch.Generator().manual_seed(0)) - 1) * torch.tensor(tiny.extent)
    rows, columns = np.nonzero(view.pixels()[..., 3] > 127)
    mask = torch.from_numpy(np.stack((columns, rows), -1) + 0.5).float()
    away = torch.cdist(view.camera.project(points), mask).amin(1) / view.camera.focal
    weight = outline(instance).silhouettes[0].weight(points)
    assert weight.shape == (400,)
    assert (weight[away < 0.4 * MARGIN] == 1).all() and (weight[away > 1.2 * MARGIN] == 0).all()
    assert 50 < int((weight == 0).sum()) < 350


@pytest.mark.parametrize("turn", [0.0, 1.0, 3.0])
def test_all_renderers_agree(tiny: Model, instance: Instance, camera: Camera, turn: float) -> None:
    camera = replace(camera, azimuth=camera.azimuth + turn)
    clear_cache()
    plain = render(instance.with_detail(None), camera, 192)
    fast = render(instance, camera, 192)
    exact = render_exact(instance, camera, 192)
    *_, baked = bake(instance)
    assert psnr(fast.colour, exact.colour.clamp(0, 1)) > 45 > psnr(plain.colour, fast.colour) + 10
    assert float((fast.opacity - exact.opacity).abs().mean()) < 0.002
    assert psnr(render_baked(baked, camera).colour.clamp(0, 1), exact.colour.clamp(0, 1)) > 25


def test_images_and_meshes_end_at_the_outline(tiny: Model, instance: Instance, camera: Camera) -> None:
    opacity = render(instance, camera, 192).opacity
    mesh = run_to_end(extract_mesh(instance, 48))
    right = int(0.55 * SIZE + 1.1 * MARGIN * camera.focal) + 1
    assert float(opacity[:, right:].max()) < 0.01 and float(opacity[:, : SIZE // 2].max()) > 0.9
    view = instance.detail.views[0]
    assert view.camera.project(torch.from_numpy(mesh.vertices))[:, 0].max() / view.camera.width < right / SIZE + 0.02


def test_thin_surfaces_within_the_mask_become_opaque(tiny: Model, camera: Camera) -> None:
    thin = tiny[0]
    plain = render_exact(thin, camera, 192)
    rgba = to_bytes(torch.cat((plain.colour.clamp(0, 1), (plain.opacity > 0.2).float()[..., None]), -1))
    view = replace(PhotoView.of(rgba, camera), outline_margin=MARGIN)
    instance = thin.changed(detail=PhotoDetail((view,), thin.codes.shape, thin.codes.texture, other_side="model"))
    opacity = render_exact(instance, camera, 192).opacity
    inside = -torch.nn.functional.max_pool2d(-(plain.opacity > 0.2)[None].float(), 5, 1, 2)[0] > 0
    veiled = inside & (plain.opacity < 0.9)
    assert int(veiled.sum()) > 20
    assert float(opacity[veiled].mean()) > float(plain.opacity[veiled].mean()) + 0.1
    assert float((opacity - plain.opacity)[inside].min()) > -0.02


def test_the_outline_fades_with_the_photo_detail(tiny: Model, instance: Instance, camera: Camera) -> None:
    detail = instance.detail
    light = [
        float(render(instance.with_detail(faded), camera, 64).opacity[:, int(0.55 * SIZE) :].sum())
        for faded in (None, *(replace(detail, strength=strength) for strength in (0.0, 0.02, 0.3, 1.0)))
    ]
    assert light[0] == light[1] == pytest.approx(light[2], rel=1e-3)
    assert light[2] >= light[3] > light[4]
    assert outline(instance.changed(shape=instance.codes.shape + 10 * FADED)) is None
    view = replace(detail.views[0], outline_margin=None)
    assert outline(instance.changed(detail=replace(detail, views=(view,)))) is None


def test_the_mirrored_mask_bounds_symmetric_objects_alone(tiny: Model) -> None:
    """From the front, a square in the middle is symmetric; a square beside it shares no point with its mirror image."""
    front = Camera(math.pi / 2, 0.0, 2.0, 90.0, SIZE, SIZE)
    points = torch.tensor([[-0.35, 0.0, 0.0], [0.0, 0.0, 0.0], [0.35, 0.0, 0.0]])
    for left, right, symmetry, inside in ((38, 58, 1, [0, 1, 0]), (56, 72, 0, [1, 0, 0]), (24, 40, 0, [0, 0, 1])):
        rgba = np.full((SIZE, SIZE, 4), 255, np.uint8)
        rgba[..., 3] = 0
        rgba[30:66, left:right, 3] = 255
        view = replace(PhotoView.of(rgba, front), outline_margin=MARGIN)
        detail = PhotoDetail((view,), tiny.codes[0].shape, tiny.codes[0].texture)
        bound = outline(tiny[0].with_detail(detail))
        assert coherence(bound.silhouettes[0]) == pytest.approx(symmetry, abs=0.01)
        assert bound.mirrored == (bool(symmetry),)
        assert (bound.factor(points) > 0).tolist() == inside


def test_points_behind_the_camera_are_finite(tiny: Model, instance: Instance) -> None:
    _, origin = instance.detail.views[0].camera.world_to_camera(torch.device("cpu"))
    points = torch.stack((origin, 2 * origin, 1e10 * origin, -1e10 * origin))
    assert torch.isfinite(outline(instance).factor(points)).all()
