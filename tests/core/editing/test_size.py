import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.nn import functional

from core.detail.progressive import render_frame
from core.editing.bounds import natural_bounds, portion_of
from core.editing.size import SIDES, bounds_of, size_of, sized, with_portion
from core.edits.bend import MAX_BEND, Bend
from core.edits.stretch import MAX_DISTORTION, Stretch
from core.export.mesh import extract_mesh
from core.geometry.camera import Camera, Factors
from core.geometry.rays import Rays, camera_rays, clip_to_box, midpoints, ray_points, uniform_edges
from core.metrics import psnr
from core.models.library import load_model
from core.models.model import Instance, Model
from core.models.motion import moved_along
from core.rendering import fast
from core.rendering.compositing import composite_on_white, compositing_weights
from core.rendering.folded_field import FoldedField
from core.rendering.occupancy import shape_occupancy
from core.rendering.reference import render_exact, render_rays
from core.runtime.precision import use_dtype
from core.streams import run_to_end
from tests.conftest import random_model
from tests.core.detail.test_maps import SIZE, striped
from tests.core.tiny import tiny_model

factors = st.tuples(*[st.floats(0.4, 2.5)] * 3)


def through_affine_camera(instance: Instance, camera: Camera, stretch: Factors) -> tuple[torch.Tensor, torch.Tensor]:
    """The plain definition: colours of the natural object along the world's rays divided by the stretch."""
    model = instance.model
    rays = camera_rays(camera, model.extent_tensor)
    origins = rays.origins / torch.tensor(stretch)
    scaled = rays.directions / torch.tensor(stretch)
    directions = functional.normalize(scaled, dim=-1)
    rays = Rays(origins, directions, *clip_to_box(origins, directions, model.extent_tensor))
    rendered = render_rays(model, rays, 256, *instance.biases)
    return rendered.colour, rendered.depth / scaled.norm(dim=-1)


@settings(max_examples=15)
@given(factors, st.floats(-math.pi, math.pi), st.floats(-1.4, 1.4))
def test_a_picture_is_one_of_the_natural_object_through_an_affine_camera(
    stretch: Factors, azimuth: float, elevation: float
):
    instance = tiny_model()[1].with_edits(Stretch, Stretch(stretch))
    camera = instance.model.camera(azimuth, elevation).resized(36, 24)
    colours, depth = through_affine_camera(instance, camera, instance.codes.proportions or (1.0,) * 3)
    exact = render_exact(instance, camera)
    torch.testing.assert_close(exact.colour, colours, atol=1e-4, rtol=0)
    assert psnr(fast.render(instance, camera, 192).colour, colours) > 42
    frame = render_frame(instance, camera)
    solid = exact.opacity.numpy() > 0.99
    np.testing.assert_allclose(frame.depth[solid], depth.numpy()[solid], atol=0.01)


@pytest.mark.parametrize("factor", [0.3, 1.7, 20.0])
def test_a_scale_changes_no_picture(tiny: Model, factor: float) -> None:
    camera = tiny.camera(0.5, 0.3)
    larger = tiny[0].with_edits(Stretch, Stretch((factor,) * 3))
    assert torch.equal(render_exact(larger, camera).colour, render_exact(tiny[0], camera).colour)
    assert larger.local_camera(camera) is camera
    assert size_of(larger) == pytest.approx([factor * side for side in size_of(tiny[0].natural)])


def test_the_natural_size_is_that_of_the_surface(tiny: Model) -> None:
    with use_dtype(torch.float32):  # bfloat16 moves soft surfaces by more
        bounds = natural_bounds(tiny[2])
        vertices = run_to_end(extract_mesh(tiny[2], 96)).vertices
    np.testing.assert_allclose(bounds.low, vertices.min(0), atol=0.004)
    np.testing.assert_allclose(bounds.high, vertices.max(0), atol=0.004)
    assert max(size_of(tiny[2].natural)) == pytest.approx(100 * tiny.metres)


def test_a_size_is_kept_until_the_natural_one_returns(tiny: Model) -> None:
    stool = sized(tiny[0], width=60.0, depth=58.0, height=92.0)
    assert size_of(stool) == pytest.approx((60, 58, 92))
    assert size_of(sized(stool, width=30.0, depth=30.0, height=30.0)) == pytest.approx((30, 30, 30))
    assert size_of(stool.with_texture(tiny[1])) == pytest.approx((60, 58, 92))
    assert sized(stool) == tiny[0] != stool
    assert sized(tiny[0], **dict(zip(SIDES, size_of(tiny[0].natural), strict=True))) == tiny[0]


@pytest.mark.parametrize(
    "size", [(0.0, 1.0, 1.0), (50.0, -1.0, 50.0), (math.nan,) * 3, (1e6, 1e6, 1e6), (1e5, 1e5, 1e5)]
)
def test_other_sizes_are_refused_in_one_line(tiny: Model, size: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match=r"^[^\n]*(cm|times)[^\n]*$"):
        sized(tiny[0], **dict(zip(SIDES, size, strict=True)))


def test_a_distortion_is_limited(tiny: Model) -> None:
    width, depth, height = size_of(tiny[0].natural)
    with pytest.raises(ValueError, match="at most 10 times as much"):
        sized(tiny[0], width=1.1 * MAX_DISTORTION * width, depth=depth, height=height)
    assert sized(tiny[0], width=0.99 * MAX_DISTORTION * width, depth=depth, height=height).is_sized


def test_a_network_that_paints_the_background_has_no_sizes() -> None:
    with pytest.raises(ValueError, match="paints the background"):
        sized(random_model(white_from_network=True)[0], width=60.0, depth=60.0, height=60.0)
    with pytest.raises(ValueError, match="paints the background"):
        sized(random_model(white_from_network=True)[0], legs=45.0)


@pytest.mark.parametrize("stretch", [(1.6, 1.0, 1.0), (1.0, 1.0, 1.5), (1.0, 1.5, 0.8)])
def test_the_photos_camera_sees_its_photo_on_a_stretched_object_too(tiny: Model, stretch: Factors) -> None:
    camera = tiny.camera(1.1, 0.3).resized(SIZE, SIZE)
    instance = striped(tiny, camera)
    natural, stretched = (
        render_frame(sized, camera).photo_shares[0]
        for sized in (instance, instance.with_edits(Stretch, Stretch(stretch)))
    )
    assert stretched > 0.93 * natural > 0.8


def through_bent_rays(instance: Instance, camera: Camera, bend: Bend) -> torch.Tensor:
    """The plain definition: colours of the natural object at the origins of points along the rays."""
    model = instance.model
    rays = camera_rays(camera, model.extent_tensor)
    edges = uniform_edges(rays, 256)
    towards = model.field.direction_bias(rays.directions)[..., None, :]
    points = ray_points(rays, midpoints(edges))
    density, colours = model.field.radiance(bend.origins(points), towards, *instance.natural.biases)
    return composite_on_white(*compositing_weights(density, edges), colours)


@pytest.mark.parametrize("bend", [Bend(-0.35, -0.05, 0.12, 0.35), Bend(-0.3, 0.0, -0.21, 0.4)])
def test_a_picture_of_a_bent_object_shows_every_height_where_the_bend_puts_it(tiny: Model, bend: Bend) -> None:
    instance = tiny[1].with_edits(Bend, bend)
    camera = tiny.camera(0.7, 0.3).resized(48, 40)
    with torch.no_grad():
        colours = through_bent_rays(instance, camera, bend)
    exact = render_exact(instance, camera)
    torch.testing.assert_close(exact.colour, colours, atol=1e-4, rtol=0)
    assert psnr(fast.render(instance, camera, 192).colour, colours) > 42
    assert psnr(render_exact(tiny[1], camera).colour, colours) < 35


@settings(max_examples=10)
@given(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-0.4, -0.31), st.floats(0.31, 0.4))
def test_a_bent_objects_cells_hold_all_that_is_dense(plane: float, moved: float, low: float, high: float):
    bend = Bend(low, plane, moved, high)
    instance = tiny_model()[2].with_edits(Bend, bend)
    points = (torch.rand(4000, 3, generator=torch.Generator().manual_seed(0)) * 2 - 1) * instance.model.extent_tensor
    natural = FoldedField.of(instance.natural).density(bend.origins(points))[0]
    density = FoldedField.of(instance).density(points)[0]
    torch.testing.assert_close(density, natural)
    inside = shape_occupancy(instance.natural).contains(bend.origins(points))
    assert bool(shape_occupancy(instance).contains(points[inside]).all())
    fraction = shape_occupancy(instance).cells.sum() / shape_occupancy(instance.natural).cells.sum()
    assert fraction < 2 * MAX_BEND


def test_legs_get_a_length_and_the_rest_keeps_its_own() -> None:
    chair = load_model("chairs")[999]
    legs = portion_of(chair.model)
    assert legs.name == "legs"
    length = bounds_of(chair).length(legs)
    assert 35 < length < 45
    tall = sized(chair, legs=length + 7)
    assert bounds_of(tall).length(legs) == pytest.approx(length + 7)
    width, depth, height = size_of(chair)
    assert size_of(tall) == pytest.approx((width, depth, height + 7))
    split = sized(tall, width=60.0, depth=58.0, height=92.0, legs=45.0)
    assert size_of(split) == pytest.approx((60, 58, 92)) and bounds_of(split).length(legs) == pytest.approx(45)
    assert size_of(sized(split, width=30.0, depth=29.0, height=46.0)) == pytest.approx((30, 29, 46))
    assert bounds_of(sized(split, width=30.0, depth=29.0, height=46.0)).length(legs) == pytest.approx(22.5)
    assert sized(split) == chair == split.natural
    assert size_of(sized(tall, legs=length)) == pytest.approx(size_of(chair))


def test_a_roof_begins_at_the_windows() -> None:
    cars = load_model("cars")
    roof = portion_of(cars)
    assert roof.name == "roof"
    natural = bounds_of(cars[0])
    high = sized(cars[0], roof=1.3 * natural.length(roof))
    assert bounds_of(high).length(roof) == pytest.approx(1.3 * natural.length(roof))
    assert size_of(high)[2] - bounds_of(high).length(roof) == pytest.approx(natural.size[2] - natural.length(roof))


def test_an_edit_of_the_shape_keeps_the_bend_and_sizes_stay_true() -> None:
    chair = sized(load_model("chairs")[999], legs=50.0)
    edited = moved_along(chair, 0, 9.0)
    assert edited.codes.edits_of("size") == chair.codes.edits_of("size") and edited.natural == moved_along(
        chair.natural, 0, 9.0
    )
    legs = portion_of(chair.model)
    again = sized(edited, legs=45.0)
    assert bounds_of(again).length(legs) == pytest.approx(45)
    rest = [size_of(instance)[2] - bounds_of(instance).length(legs) for instance in (edited, again)]
    assert rest[0] == pytest.approx(rest[1])


@pytest.mark.parametrize("length", [0.0, -1.0, math.nan, math.inf, 1.0, 1e4])
def test_other_lengths_are_refused_in_one_line(length: float) -> None:
    chair = load_model("chairs")[999]
    with pytest.raises(ValueError, match=r"^[^\n]*cm[^\n]*$"):
        sized(chair, legs=length)
    if length > 0:
        with_portion(chair, natural_bounds(chair), length)  # as near as limits allow


def test_an_object_without_the_part_has_no_such_length(tiny: Model) -> None:
    with pytest.raises(ValueError, match="only width, depth, height"):
        sized(tiny[0], legs=45.0)
    chairs = load_model("chairs")
    with pytest.raises(ValueError, match="only width, depth, height, legs"):
        sized(chairs[999], roof=45.0)
    assert natural_bounds(load_model("cars")[702]).plane is None  # it has no windows


def test_photo_detail_is_stretched_with_the_object(tiny: Model) -> None:
    far = tiny.camera(1.1, 0.0, 40.0)  # nearly no perspective: there an image is stretched like the object
    camera = Camera(1.1, 0.0, 40.0, 20 * far.focal * SIZE / far.height, SIZE, SIZE)
    instance = striped(tiny, camera)
    photo = torch.from_numpy(instance.detail.views[0].pixels()[..., :3] / 255).float()
    stretched = instance.with_edits(Stretch, Stretch((1.0, 1.0, 1.4)))
    width, _, height = stretched.codes.proportions
    axis = (torch.arange(SIZE) + 0.5) / SIZE * 2 - 1
    uv = torch.stack(torch.meshgrid(axis * height, axis * width, indexing="ij")[::-1], -1)

    def seen_as_natural(instance: Instance) -> torch.Tensor:
        image = torch.from_numpy(render_frame(instance, camera).image / 255).float().movedim(-1, 0)
        return functional.grid_sample(image[None], uv[None], align_corners=False)[0].movedim(0, -1)

    rows = slice(int(0.45 * SIZE), int(0.6 * SIZE))  # around the stripe
    quality = psnr(seen_as_natural(stretched)[rows], photo[rows])
    plain_quality = psnr(seen_as_natural(stretched.with_detail(None))[rows], photo[rows])
    assert quality > max(30, plain_quality + 5)


def test_photo_detail_is_bent_with_the_object(tiny: Model) -> None:
    far = tiny.camera(1.1, 0.0, 40.0)  # nearly no perspective: there an image is bent like the object
    camera = Camera(1.1, 0.0, 40.0, 20 * far.focal * SIZE / far.height, SIZE, SIZE)
    instance = striped(tiny, camera)
    bend = Bend(-0.35, 0.0, 0.1, 0.35)
    heights = (SIZE / 2 - torch.arange(SIZE) - 0.5) * camera.distance / camera.focal
    origins = bend.origins(torch.stack((torch.zeros(SIZE), torch.zeros(SIZE), heights), -1))[:, 2]
    rows = SIZE / 2 - 0.5 - origins * camera.focal / camera.distance
    photo = torch.from_numpy(instance.detail.views[0].pixels()[..., :3] / 255).float()
    expected = photo[rows.round().long().clamp(0, SIZE - 1)]
    with_detail, plain = (
        torch.from_numpy(render_frame(bent, camera).image / 255).float()
        for bent in (instance.with_edits(Bend, bend), instance.changed(edits=(bend,), detail=None))
    )
    stripe = ((origins * camera.focal / camera.distance).abs() < 0.06 * SIZE).nonzero()[:, 0]
    assert psnr(with_detail[stripe], expected[stripe]) > max(25, psnr(plain[stripe], expected[stripe]) + 5)
