import pytest
import torch

from core.models.model import Instance, Model
from core.models.motion import LIMIT, motion, moved_along, reach, warp_to_fitted
from core.models.photo_detail import PhotoDetail, PhotoView
from core.rendering.surface import surface_points
from tests.conftest import random_model


@pytest.fixture
def fitted(tiny: Model) -> Instance:
    """A stool fitted to a photo."""
    instance = tiny[0]
    rgba = torch.full((8, 8, 4), 255, dtype=torch.uint8).numpy()
    view = PhotoView.of(rgba, tiny.camera(1.0, 0.3).resized(8, 8))
    return instance.with_detail(PhotoDetail.of((view,), instance.codes))


def coordinate(instance: Instance, direction: int) -> float:
    return float(instance.model.codes.shape_space.coordinates(instance.codes.shape)[direction])


def height(instance: Instance) -> float:
    points = surface_points(instance.with_detail(None))[0]
    return float(points[:, 2].max() - points[:, 2].min())


def taller(model: Model) -> tuple[int, int]:
    """The direction that changes the height most, and the sign that makes objects taller."""
    basis = model.codes.shape_space.basis
    direction = int(basis[:, 0].abs().argmax())  # the first code makes it taller
    return direction, 1 if basis[direction, 0] > 0 else -1


def test_edits_move_the_surface_and_go_back_exactly(tiny: Model, fitted: Instance) -> None:
    direction, sign = taller(tiny)
    start = coordinate(fitted, direction)
    higher = moved_along(fitted, direction, start + sign * LIMIT)
    assert coordinate(higher, direction) == pytest.approx(start + sign * LIMIT, abs=1e-3)
    assert height(higher) > height(fitted) + 0.02
    assert higher.codes.texture is fitted.codes.texture and higher.detail is fitted.detail
    again = moved_along(higher, direction, start)
    assert again.codes.shape_key == fitted.codes.shape_key


def test_edits_end_where_the_object_would_break_also_after_other_edits(tiny: Model, fitted: Instance) -> None:
    direction, _ = taller(tiny)
    start = coordinate(fitted, direction)
    far = moved_along(fitted, direction, start + 99)
    assert coordinate(far, direction) == pytest.approx(start + LIMIT, abs=1e-3)
    for instance in (fitted, far, moved_along(far, 1 - direction, 0.3)):
        assert reach(instance, direction) == pytest.approx((start - LIMIT, start + LIMIT), abs=1e-3)


def test_objects_beyond_the_limit_stay_as_they_are_and_move_on_from_there(tiny: Model, fitted: Instance) -> None:
    direction, _ = taller(tiny)
    stored = fitted.moved("shape", 3 * tiny.codes.shape_space.basis[direction])
    position = coordinate(stored, direction)
    low, high = reach(stored, direction)
    assert (low + high) / 2 == pytest.approx(position, abs=1e-3)
    assert high - position < LIMIT - 0.1  # an unusual shape breaks earlier
    assert moved_along(stored, direction, position).codes.shape_key == stored.codes.shape_key


def test_a_warp_leads_points_of_the_edited_surface_back_to_the_fitted_one(tiny: Model, fitted: Instance) -> None:
    direction, sign = taller(tiny)
    assert warp_to_fitted(fitted) is None
    higher = moved_along(fitted, direction, coordinate(fitted, direction) + sign * LIMIT)
    warp = warp_to_fitted(higher)
    assert warp is not None
    surface = motion(tiny, higher.codes).surface
    top, moved, back = (
        float(points[:, 2].quantile(0.98))
        for points in (motion(tiny, fitted.codes).surface, surface, warp.origins(surface))
    )
    assert moved > top + 0.02
    assert abs(back - top) < 0.8 * (moved - top)


def test_objects_of_the_authors_networks_move_by_their_codes_alone() -> None:
    model = random_model(white_from_network=True)
    instance = model[0]
    moved = moved_along(instance, 0, coordinate(instance, 0) + 0.5)
    step = model.codes.shape_space.basis[0]
    assert torch.allclose(moved.codes.shape, instance.codes.shape + 0.5 * step, atol=1e-5)
    assert moved.codes.shape_offsets is None
