from dataclasses import replace

import pytest
import torch

from core.models.codes import Codes
from core.models.model import Model
from core.models.photo_detail import PhotoDetail, PhotoView
from core.rendering.motion import LIMIT, motion, moved_along, reach, warp_to_fitted
from core.rendering.surface import surface_points
from tests.conftest import random_model


@pytest.fixture
def fitted(tiny: Model) -> Codes:
    """A stool fitted to a photo."""
    codes = tiny.codes[0]
    rgba = torch.full((8, 8, 4), 255, dtype=torch.uint8).numpy()
    view = PhotoView.of(rgba, tiny.camera(1.0, 0.3).resized(8, 8))
    return replace(codes, detail=PhotoDetail.of((view,), codes))


def coordinate(model: Model, codes: Codes, direction: int) -> float:
    return float(model.codes.shape_space.coordinates(codes.shape)[direction])


def height(model: Model, codes: Codes) -> float:
    points = surface_points(model, replace(codes, detail=None))[0]
    return float(points[:, 2].max() - points[:, 2].min())


def taller(model: Model) -> tuple[int, int]:
    """The direction that changes the height most, and the sign that makes objects taller."""
    basis = model.codes.shape_space.basis
    direction = int(basis[:, 0].abs().argmax())  # the first code makes it taller
    return direction, 1 if basis[direction, 0] > 0 else -1


def test_edits_move_the_surface_and_go_back_exactly(tiny: Model, fitted: Codes) -> None:
    direction, sign = taller(tiny)
    start = coordinate(tiny, fitted, direction)
    higher = moved_along(tiny, fitted, direction, start + sign * LIMIT)
    assert coordinate(tiny, higher, direction) == pytest.approx(start + sign * LIMIT, abs=1e-3)
    assert height(tiny, higher) > height(tiny, fitted) + 0.02
    assert higher.texture is fitted.texture and higher.detail is fitted.detail
    again = moved_along(tiny, higher, direction, start)
    assert again.shape_key == fitted.shape_key


def test_edits_end_where_the_object_would_break_also_after_other_edits(tiny: Model, fitted: Codes) -> None:
    direction, _ = taller(tiny)
    start = coordinate(tiny, fitted, direction)
    far = moved_along(tiny, fitted, direction, start + 99)
    assert coordinate(tiny, far, direction) == pytest.approx(start + LIMIT, abs=1e-3)
    for codes in (fitted, far, moved_along(tiny, far, 1 - direction, 0.3)):
        assert reach(tiny, codes, direction) == pytest.approx((start - LIMIT, start + LIMIT), abs=1e-3)


def test_codes_beyond_the_limit_stay_as_they_are_and_move_on_from_there(tiny: Model, fitted: Codes) -> None:
    direction, _ = taller(tiny)
    stored = replace(fitted, shape=fitted.shape + 3 * tiny.codes.shape_space.basis[direction])
    now = coordinate(tiny, stored, direction)
    low, high = reach(tiny, stored, direction)
    assert (low + high) / 2 == pytest.approx(now, abs=1e-3)
    assert high - now < LIMIT - 0.1  # an unusual shape breaks earlier
    assert moved_along(tiny, stored, direction, now).shape_key == stored.shape_key


def test_a_warp_leads_points_of_the_edited_surface_back_to_the_fitted_one(tiny: Model, fitted: Codes) -> None:
    direction, sign = taller(tiny)
    assert warp_to_fitted(tiny, fitted, fitted) is None
    higher = moved_along(tiny, fitted, direction, coordinate(tiny, fitted, direction) + sign * LIMIT)
    warp = warp_to_fitted(tiny, fitted, higher)
    assert warp is not None
    surface = motion(tiny, higher).surface
    top, moved, back = (
        float(points[:, 2].quantile(0.98)) for points in (motion(tiny, fitted).surface, surface, warp.origins(surface))
    )
    assert moved > top + 0.02
    assert abs(back - top) < 0.8 * (moved - top)


def test_codes_of_the_authors_networks_move_alone() -> None:
    model = random_model(white_from_network=True)
    codes = model.codes[0]
    moved = moved_along(model, codes, 0, coordinate(model, codes, 0) + 0.5)
    step = model.codes.shape_space.basis[0]
    assert torch.allclose(moved.shape, codes.shape + 0.5 * step, atol=1e-5)
    assert moved.shape_offsets is None
