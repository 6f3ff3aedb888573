import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from core.edits import kinds
from core.edits.warp import Warp
from core.models.library import load_model
from core.models.model import Instance, Model
from core.models.motion import DIRECTIONS, LIMIT, edits_to_fitted, motion, moved_along, moved_by, position, reach
from core.models.photo_detail import PhotoDetail, PhotoView
from core.rendering.folded_field import FoldedField
from core.rendering.images import render_image
from core.rendering.reference import render_exact
from core.rendering.surface import surface_points
from tests.conftest import random_model


@pytest.fixture
def fitted(tiny: Model) -> Instance:
    """A stool fitted to a photo."""
    instance = tiny[0]
    rgba = torch.full((8, 8, 4), 255, dtype=torch.uint8).numpy()
    view = PhotoView.of(rgba, tiny.camera(1.0, 0.3).resized(8, 8))
    return instance.with_detail(PhotoDetail.of((view,), instance.codes))


@pytest.fixture(scope="module")
def car() -> Instance:
    return load_model("cars")[3]


def test_edits_keep_codes_and_go_back_exactly(fitted: Instance) -> None:
    start = position(fitted, 0)
    moved = moved_along(moved_along(fitted, 0, start + 0.3), 0, start + 0.7)
    assert position(moved, 0) == pytest.approx(start + 0.7, abs=1e-3)
    assert position(moved, 1) == position(fitted, 1)
    assert moved.codes.shape is fitted.codes.shape and moved.detail is fitted.detail
    assert moved != fitted and hash(moved) != hash(fitted)
    again = moved_along(moved, 0, start)
    assert again == fitted and not again.codes.edits


def test_edits_end_at_the_same_place_after_other_edits(fitted: Instance) -> None:
    start = position(fitted, 0)
    far = moved_along(fitted, 0, start + 99)
    assert position(far, 0) == pytest.approx(start + LIMIT, abs=1e-3)
    for instance in (fitted, far, moved_along(far, 1, 0.3)):
        assert reach(instance, 0) == pytest.approx((start - LIMIT, start + LIMIT), abs=1e-3)


@given(st.lists(st.floats(-LIMIT, LIMIT), min_size=DIRECTIONS, max_size=DIRECTIONS))
@settings(max_examples=6, deadline=None)
def test_the_edited_field_is_the_field_where_places_came_from(car: Instance, moves: list[float]) -> None:
    edited = moved_by(car, tuple(moves))
    points = car.model.extent_tensor * (2 * torch.rand(500, 3, generator=torch.Generator().manual_seed(0)) - 1)
    origins = kinds.origins(points, edited.codes.edits)
    assert bool((origins.abs() <= car.model.extent_tensor + 1e-6).all())
    density, features = FoldedField.of(car).density(origins)
    expected = kinds.densities(density, edited.codes.edits), features
    torch.testing.assert_close(FoldedField.of(edited).density(points), expected)


@given(st.lists(st.sampled_from((-LIMIT, 0.0, LIMIT)), min_size=DIRECTIONS, max_size=DIRECTIONS))
@settings(max_examples=20, deadline=None)
def test_space_never_folds(car: Instance, moves: list[float]) -> None:
    """Where the object is, a place of the edited object comes from a neighbourhood of the same orientation."""
    edits = moved_by(car, tuple(moves)).codes.edits
    points = (0.98 * motion(car.model, car.codes).surface).detach().requires_grad_(True)
    origins = kinds.origins(points, edits)
    rows = [torch.autograd.grad(origins[:, axis].sum(), points, retain_graph=True)[0] for axis in range(3)]
    inside = (origins.abs() < car.model.extent_tensor).all(1)
    assert float(torch.linalg.det(torch.stack(rows, 1))[inside].min()) > 0.1


@pytest.mark.parametrize("direction", range(DIRECTIONS))
def test_moves_keep_the_bounds(car: Instance, direction: int) -> None:
    """A car stands on the ground, as long, wide and high as before."""
    ends = []
    for instance in (car, moved_along(car, direction, position(car, direction) + LIMIT)):
        points = surface_points(instance)[0]
        ends.append(torch.cat((points.amin(0), points.amax(0))))
    cell = 2 * max(car.model.extent) / 40
    assert float((ends[0] - ends[1]).abs().max()) <= 2.01 * cell


def test_the_fast_renderer_agrees_with_the_exact_one(car: Instance) -> None:
    edited = moved_by(car, (1.5, -1.0, 2.0, 0.5, -0.5, 1.0))
    camera = car.model.camera(0.8, 0.3).resized(40, 40)
    exact = render_exact(edited, camera, 192)
    fast = render_image(edited, camera)
    assert float((exact.opacity - render_exact(car, camera, 192).opacity).abs().max()) > 0.5
    assert float((exact.colour - fast.colour).abs().mean()) < 0.01


def test_photos_follow_edits_as_the_field_does(fitted: Instance) -> None:
    assert edits_to_fitted(fitted) == ()
    edited = moved_along(fitted, 0, position(fitted, 0) + 1.0)
    assert edits_to_fitted(edited) == edited.codes.edits != ()


def test_photos_follow_a_code_that_moved_along_the_first_directions(tiny: Model, fitted: Instance) -> None:
    """As in mixes with another shape."""
    mixed = fitted.moved("shape", 0.4 * tiny.codes.shape_space.basis[0])
    assert mixed.codes.edits == () and len(edits_to_fitted(mixed)) == 1


def test_edits_mix_and_follow_the_shape(car: Instance) -> None:
    edited = moved_by(car, (1.0, 0.0, 0.0, 0.0, 0.0, -2.0))
    (mixed,) = car.mixed(edited, 0.25, 1.0).codes.of_kind(Warp)
    assert mixed.steps == (0.25, 0.0, 0.0, 0.0, 0.0, -0.5)
    second = car.model[5]
    assert second.with_shape(edited).codes.edits == edited.codes.edits
    assert second.with_texture(edited).codes.edits == ()
    assert moved_by(edited, (0.0,) * 6) == car


def test_an_edited_object_becomes_another_one_evenly(car: Instance) -> None:
    """Every frame of a morph moves places by the same way."""
    edited = moved_by(car, (2.0, 0.0, 0.0, -2.0, 0.0, 1.0))
    points = motion(car.model, car.codes).surface
    positions = torch.stack(
        [kinds.origins(points, edited.mixed(car.model[9], amount, 0.0).codes.edits) for amount in (0.0, 0.1, 0.2)]
    )
    first, second = positions.diff(dim=0)
    assert float(first.norm(dim=-1).mean()) > 1e-4
    torch.testing.assert_close(first, second, atol=1e-6, rtol=1e-3)


@pytest.mark.parametrize("steps", [(1.0,) * 3, (1.0,) * 7, (math.nan,) * 6, (1e39,) * 6, (0.0,) * 100_000])
def test_a_warp_of_other_directions_is_refused(car: Instance, steps: tuple[float, ...]) -> None:
    edited = moved_by(car, (1.0,) * 6)
    assert car.model.fits(edited.codes)
    with pytest.raises(ValueError, match="a warp"):
        if car.model.fits(edited.with_edits(Warp, replace(edited.codes.of_kind(Warp)[0], steps=steps)).codes):
            return
        raise ValueError("a warp of another model")
    assert not random_model(white_from_network=True).fits(edited.codes)


def test_objects_of_the_authors_networks_move_by_their_codes_alone() -> None:
    model = random_model(white_from_network=True)
    instance = model[0]
    moved = moved_along(instance, 0, position(instance, 0) + 0.5)
    step = model.codes.shape_space.basis[0]
    assert torch.allclose(moved.codes.shape, instance.codes.shape + 0.5 * step, atol=1e-5)
    assert moved.codes.edits == ()
