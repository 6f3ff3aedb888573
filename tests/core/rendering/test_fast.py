import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.nn import functional

from core.geometry.camera import _world_to_camera as placing
from core.geometry.rays import camera_rays, midpoints, ray_points, uniform_edges
from core.metrics import psnr
from core.models.codes import Codes
from core.models.field import encode
from core.models.library import load_model
from core.models.model import Instance, Model
from core.rendering import fast as renderer
from core.rendering.fast import render
from core.rendering.folded_field import FoldedField
from core.rendering.folded_layers import AxisLookup
from core.rendering.occupancy import Occupancy, OccupiedIntervals, tolerances
from core.rendering.reference import render_exact, render_rays
from core.runtime.caches import CACHE, CacheKind, byte_count
from core.runtime.precision import use_dtype
from tests.conftest import random_model, with_contrast

MODEL = random_model()
seeds = st.integers(0, 2**31)


def drawn(seed: int, spread: float = 1.0) -> Instance:
    """An object with random codes of this standard deviation."""
    generator = torch.Generator().manual_seed(seed)
    codes = Codes(spread * torch.randn(8, generator=generator), spread * torch.randn(4, generator=generator))
    return Instance(MODEL, codes)


@given(seeds, st.sampled_from([1.0, 5.0]))
def test_folding_is_exact(seed: int, spread: float):
    instance = drawn(seed, spread)
    generator = torch.Generator().manual_seed(seed)
    points = torch.rand(40, 3, generator=generator) - 0.5
    directions = torch.nn.functional.normalize(torch.randn(40, 3, generator=generator), dim=-1)
    with pytest.MonkeyPatch.context() as patch, use_dtype(torch.float32):
        patch.setattr(AxisLookup, "__call__", AxisLookup.evaluate)
        folded = FoldedField(instance)
        density, y = folded.density(points)
        colour = folded.colour(y, folded.direction_bias(directions))
    field = MODEL.field
    true_density, features = field.density(points, field.shape_bias(instance.codes.shape))
    true_colour = field.colour(features, field.direction_bias(directions), field.texture_bias(instance.codes.texture))
    torch.testing.assert_close(density, true_density, atol=3e-4, rtol=1e-5)
    torch.testing.assert_close(colour, true_colour, atol=1e-5, rtol=1e-5)


def test_tables_approximate_a_linear_layer_of_an_encoding():
    generator = torch.Generator().manual_seed(0)
    weight = torch.randn(16, 3 + 6 * 8, generator=generator)
    bias = torch.randn(16, generator=generator)
    reach = torch.tensor([0.5, 0.4, 1.0])
    tables = AxisLookup.from_layer(8, weight, bias, reach, torch.float32)
    points = (2 * torch.rand(300, 3, generator=generator) - 1) * reach
    entries = len(tables.entries) // 3
    middles = ((points / reach + 1) * entries / 2).floor().add(0.5) * 2 / entries - 1
    for values, error in ((middles * reach, 1e-3), (points, 0.3)):
        expected = functional.linear(encode(values, 8), weight, bias)
        torch.testing.assert_close(tables(values), expected, atol=error, rtol=0)


@settings(max_examples=15)
@given(seeds, st.sampled_from([1.0, 5.0]), st.floats(-3.1, 3.1), st.floats(-1.5, 1.5))
def test_every_dense_point_lies_in_an_occupied_cell_and_in_its_pixels_depth_range(seed, spread, azimuth, elevation):
    instance = drawn(seed, spread)
    camera = MODEL.camera(azimuth, elevation)
    occupancy = Occupancy.of(MODEL, FoldedField(instance))
    rays = camera_rays(camera, MODEL.extent_tensor)
    depths = midpoints(uniform_edges(rays, 40))
    points = ray_points(rays, depths)
    density, _ = MODEL.field.density(points, MODEL.field.shape_bias(instance.codes.shape))
    crossed = (rays.far > rays.near)[..., None]
    dense = (density * float(occupancy.cell.amin()) > 0.1) & crossed
    assert bool((occupancy.contains(points) | ~dense).all())
    near, far = occupancy.depth_range(camera)
    inside = (depths >= near[..., None]) & (depths <= far[..., None])
    assert bool((inside | ~dense).all())


@pytest.mark.parametrize("contrast", [0.0, 20.0])
def test_the_fast_renderer_matches_the_reference(contrast: float):
    model = with_contrast(MODEL, contrast)
    camera = model.camera(0.7, 0.4)
    exact = render_exact(model[3], camera)
    fast = render(model[3], camera, 256)
    assert psnr(fast.colour, exact.colour) > 38
    assert float((fast.opacity - exact.opacity).abs().max()) < 0.05
    solid = exact.opacity > 0.5
    torch.testing.assert_close(fast.depth[solid], exact.depth[solid], atol=0.02, rtol=0.02)
    missed = exact.opacity == 0  # beside the scene's box
    assert bool(missed[0, 0]) and not fast.depth[missed].any() and bool((fast.colour[missed] == 1).all())


def test_the_size_of_chunks_does_not_change_the_image(monkeypatch):
    camera = MODEL.camera(0.7, 0.4)
    expected = render(MODEL[0], camera, 96)
    renderer.clear_views()
    monkeypatch.setattr(renderer, "CHUNK_RAYS", 37)
    chunked = render(MODEL[0], camera, 96)
    assert psnr(chunked.colour, expected.colour) > 50


def test_a_new_texture_or_view_keeps_the_occupancy():
    renderer.clear_cache()
    render(MODEL[0], MODEL.camera(0.1, 0.1), 8)
    render(MODEL[0].with_texture(MODEL[1]), MODEL.camera(0.9, 0.1), 8)
    assert len(CACHE.newest(CacheKind.SHAPE)) == 1
    render(MODEL[1], MODEL.camera(0.9, 0.1), 8)
    assert len(CACHE.newest(CacheKind.SHAPE)) == 2


def test_a_new_texture_on_a_cached_view_equals_a_full_render_and_moves_no_silhouette():
    camera = MODEL.camera(0.3, 0.2)
    textured = MODEL[0].with_texture(MODEL[1])
    renderer.clear_views()
    full = render(textured, camera, 96)
    renderer.clear_views()
    first = render(MODEL[0], camera, 96)
    assert renderer.is_cached(textured, camera, 96)
    assert not renderer.is_cached(MODEL[1], camera, 96)
    assert not renderer.is_cached(textured, MODEL.camera(0.31, 0.2), 96)
    recoloured = render(textured, camera, 96)
    torch.testing.assert_close(recoloured.colour, full.colour, atol=0, rtol=0)
    assert not torch.equal(first.colour, full.colour)
    assert torch.equal(first.opacity, full.opacity)
    assert torch.equal(first.depth, full.depth)


def test_views_are_cached_within_the_limit_and_rendered_alike_without_room(monkeypatch: pytest.MonkeyPatch):
    renderer.clear_cache()
    camera = MODEL.camera(0.3, 0.2).resized(64, 64)
    render(MODEL[0], camera, 96)
    view = CACHE.used - sum(byte_count(occupancy) for _, occupancy in CACHE.newest(CacheKind.SHAPE))
    monkeypatch.setattr(CACHE, "limit", CACHE.used + view // 2)
    for turn in range(10):
        render(MODEL[0], replace(camera, azimuth=0.1 * turn), 96)
        assert CACHE.used <= CACHE.limit
    assert renderer.is_cached(MODEL[0], replace(camera, azimuth=0.9), 96)
    renderer.clear_cache()
    camera = MODEL.camera(0.3, 0.2).resized(64, 64)
    cached = render(MODEL[0], camera, 96)
    renderer.clear_views()
    monkeypatch.setattr(CACHE, "limit", CACHE.used + 1000)
    assert torch.equal(render(MODEL[0], camera, 96).colour, cached.colour)
    assert not renderer.is_cached(MODEL[0], camera, 96)


def test_rays_pass_pixel_corners_if_the_network_paints_the_background():
    painted = random_model(white_from_network=True)
    instance = painted[0]
    camera = painted.camera(0.4, 0.3)
    plain = replace(painted, white_from_network=False)
    rays = camera_rays(camera, plain.extent_tensor, 0.5)
    biases = plain.field.shape_bias(instance.codes.shape), plain.field.texture_bias(instance.codes.texture)
    exact = render_rays(plain, rays, 96, *biases)
    rendered = render(instance, camera, 96)
    assert psnr(rendered.colour.clamp(0, 1), exact.colour.clamp(0, 1)) > 40
    assert psnr(render(plain[0], camera, 96).colour.clamp(0, 1), exact.colour.clamp(0, 1)) < 40


def test_the_occupancy_of_a_changing_shape_follows_the_previous_one(tiny: Model):
    steps = [tiny[0].mixed(tiny[2], number / 20, 0.0) for number in range(9)]
    occupancy = Occupancy.of(tiny, FoldedField(steps[0]))
    for instance in steps[1:]:
        occupancy = Occupancy.of(tiny, FoldedField(instance), occupancy)
        complete = Occupancy.of(tiny, FoldedField(instance))
        assert not occupancy.complete
        assert not bool((occupancy.cells & ~complete.cells).any())
        assert float((complete.cells & ~occupancy.cells).sum()) <= 0.001 * float(complete.cells.sum())


@pytest.mark.parametrize(("name", "deviations"), [("chairs", 0.0), ("chairs", 5.0), ("cars", 1.0), ("cars", 5.0)])
def test_the_occupancy_by_stored_cells_misses_no_cell_of_an_unusual_shape(name: str, deviations: float):
    model = load_model(name)
    generator = torch.Generator().manual_seed(0)
    space = model.codes.shape_space
    start = model[int(torch.randint(100, (), generator=generator))]
    size = len(space.std)
    direction = torch.randn(size, generator=generator) * (torch.rand(size, generator=generator) < 0.1)
    instance = start.moved("shape", space.code(deviations * direction) - space.mean)
    complete = Occupancy.of(replace(model, stored_cells=None), FoldedField(instance))
    missed = complete.cells & ~Occupancy.of(model, FoldedField(instance)).cells
    assert float(missed.sum()) < 1e-3 * float(complete.cells.sum())


def test_the_occupancy_outside_all_stored_cells_is_complete(tiny: Model):
    instance = tiny[0]
    without_cells = replace(tiny, stored_cells=torch.zeros(32, 32, 32, dtype=torch.bool))
    complete = Occupancy.of(replace(tiny, stored_cells=None), FoldedField(instance))
    assert bool(complete.cells.any())
    assert torch.equal(Occupancy.of(without_cells, FoldedField(instance)).cells, complete.cells)


def test_a_cached_preview_of_a_changing_shape_does_not_replace_the_finished_render(tiny: Model):
    renderer.clear_cache()
    mixed = tiny[0].mixed(tiny[2], 0.05, 0)
    render(tiny[0], tiny.camera(0.5, 0.3), 48)
    preview = render(mixed, tiny.camera(0.5, 0.3), 48, complete=False)
    finished = render(mixed, tiny.camera(0.5, 0.3), 48)
    renderer.clear_cache()
    expected = render(mixed, tiny.camera(0.5, 0.3), 48)
    assert torch.equal(finished.colour, expected.colour)
    assert psnr(preview.colour, expected.colour) > 50


def test_rays_without_occupied_intervals_are_white(monkeypatch: pytest.MonkeyPatch):
    """A pixel's depth range may be filled although its ray passes beside all occupied cells."""
    none = torch.zeros(0, dtype=torch.long)
    monkeypatch.setattr(Occupancy, "intersect", lambda self, *_: OccupiedIntervals(none, none, none.bool()))
    renderer.clear_views()
    rendered = render(MODEL[1], MODEL.camera(0.5, 0.3), 8)
    assert bool((rendered.colour == 1).all())
    assert float(rendered.opacity.max()) == 0
    renderer.clear_views()


def test_early_termination_loses_no_visible_light(tiny: Model, monkeypatch: pytest.MonkeyPatch):
    def colour() -> torch.Tensor:
        renderer.clear_views()
        return render(tiny[2], tiny.camera(0.5, 0.3), 192).colour

    terminated = colour()
    monkeypatch.setattr(renderer, "tolerances", lambda samples: tolerances(samples)._replace(termination=math.inf))
    assert float((colour() - terminated).abs().max()) < 0.005


def test_finer_intervals_never_cost_quality():
    """In fog each interval absorbs little light, less the finer the intervals: none of it may be lost."""
    instance = MODEL[2]
    camera = MODEL.camera(0.5, 0.3)
    exact = render_exact(instance, camera, 512).colour.clamp(0, 1)
    qualities = [psnr(render(instance, camera, samples).colour.clamp(0, 1), exact) for samples in (32, 96, 256)]
    assert qualities == sorted(qualities)


def test_every_tensor_is_created_on_the_models_device():
    model = random_model(seed=5)
    instance = model[0]
    camera = model.camera(0.4, 0.3)
    expected = render(instance, camera, 32)
    exact = render_exact(instance, camera, 8)
    fresh = random_model(seed=5)[0]  # with nothing cached
    placing.cache_clear()
    with torch.device("meta"):  # a tensor created without a device has no values here, and operations with it fail
        assert torch.equal(render(fresh, camera, 32).colour, expected.colour)
        assert torch.equal(render_exact(fresh, camera, 8).colour, exact.colour)
