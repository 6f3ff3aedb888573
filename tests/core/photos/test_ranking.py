import math

import pytest
import torch

from core.metrics import rotation_error
from core.models.model import Model
from core.photos.ranking import ObjectMask, expected_scales, rank_cameras, shape_similarity
from core.rendering.reference import Rendered, render_exact
from tests.core.tiny import tiny_bank

VIEWS = [(0.3, 0.3), (1.4, 0.7), (2.5, 0.1), (3.7, 0.9), (4.6, 0.4), (5.6, 1.3)]


def image_of(frame: Rendered, focal: float) -> ObjectMask:
    return ObjectMask(frame.opacity > 0.5, focal)


@pytest.mark.parametrize("azimuth, elevation", VIEWS)
def test_the_true_camera_is_among_the_best_candidates(tiny: Model, azimuth: float, elevation: float):
    camera = tiny.camera(azimuth, elevation)
    frame = render_exact(tiny[1], camera, 48)  # wide, so that front and side differ in outline
    candidates = rank_cameras(tiny_bank(), image_of(frame, camera.focal), 8)
    errors = [
        rotation_error(tiny.camera(float(a), float(e)), camera)
        for a, e in zip(candidates.azimuth, candidates.elevation, strict=True)
    ]
    assert min(errors) < 25


def test_every_candidate_comes_with_its_opposite_view(tiny: Model):
    frame = render_exact(tiny[0], tiny.camera(0.5, 0.4), 32)
    candidates = rank_cameras(tiny_bank(), image_of(frame, tiny.focal), 8)
    pairs = candidates.azimuth.reshape(4, 2)
    assert torch.allclose((pairs[:, 0] - pairs[:, 1]).cos(), torch.tensor(-1.0), atol=1e-5)
    assert torch.equal(candidates.elevation[::2], candidates.elevation[1::2])
    assert len({(round(float(a), 4), round(float(e), 4)) for a, e in zip(*candidates[:2], strict=True)}) == 8


def test_a_prototype_is_most_similar_to_itself(tiny: Model):
    bank = tiny_bank()
    for index in range(len(bank.prototypes)):
        for azimuth, elevation in ((0.8, 0.2), (2.0, 1.35)):
            instance = tiny.mean.changed(shape=bank.shapes(tiny.codes)[index])
            frame = render_exact(instance, tiny.camera(azimuth, elevation), 32)
            scores = shape_similarity(bank, image_of(frame, tiny.focal), azimuth, elevation)
            assert float(scores[index]) > float(scores.max()) - 0.05


@pytest.mark.parametrize("factor", [0.75, 1.0, 1.4])
def test_the_distance_follows_from_the_apparent_size(tiny: Model, factor: float):
    camera = tiny.camera(1.0, 0.5, factor * tiny.distance)
    frame = render_exact(tiny[0], camera, 48)
    candidates = rank_cameras(tiny_bank(), image_of(frame, camera.focal), 4)
    assert float(candidates.distance[0]) == pytest.approx(camera.distance, rel=0.3)


def test_expected_scales_compare_sizes_from_every_direction(tiny: Model):
    bank = tiny_bank()
    usual, larger = (
        expected_scales(bank, image_of(render_exact(tiny[2], tiny.camera(1.0, 0.5), 48), focal))
        for focal in (tiny.focal, tiny.focal / 2)
    )
    assert float(usual.abs().median()) < 0.3
    torch.testing.assert_close(larger - usual, torch.full_like(usual, math.log(2)))


@pytest.mark.parametrize(("side", "azimuth"), [(0, 2.2), (1, -1.2)])
def test_knowing_the_truncating_edge_improves_the_position(tiny: Model, side: int, azimuth: float):
    bank = tiny_bank()
    instance = tiny.mean.changed(shape=bank.shapes(tiny.codes)[1])
    frame = render_exact(instance, tiny.camera(azimuth, 0.5), 48)
    mask = frame.opacity > 0.5
    first, last = (int(end) for end in mask.any(1 - side).nonzero()[[0, -1], 0])
    unseen = torch.zeros_like(mask)
    unseen.movedim(side, 0)[: first + (last - first) // 3] = True
    visible = mask & ~unseen
    complete = rank_cameras(bank, image_of(frame, tiny.focal), 1, cropped=True)
    images = (ObjectMask(visible, tiny.focal, edge) for edge in (None, unseen))
    shifts = (rank_cameras(bank, image, 1, cropped=True).shift for image in images)
    error_without_edge, error_with_edge = (float((shift - complete.shift).norm()) for shift in shifts)
    assert error_with_edge < 0.6 * error_without_edge


def test_a_mask_of_one_pixel_has_cameras_ranked_by_the_viewpoint(tiny: Model):
    mask = torch.zeros(16, 16, dtype=torch.bool)
    mask[5, 7] = True
    bank = tiny_bank()
    candidates = rank_cameras(bank, ObjectMask(mask, 30.0), 6)
    assert bool(candidates.distance.isfinite().all())
    assert float(candidates.distance.max()) <= 2 * tiny.distance
    assert float(candidates.elevation.abs().max()) < math.pi / 2
    viewpoint = torch.full_like(bank.azimuth, 1e-9)
    viewpoint[40] = 1.0
    best = rank_cameras(bank, ObjectMask(mask, 30.0), 2, viewpoint, cropped=True)
    assert (best.azimuth[0], best.elevation[0]) == (bank.azimuth[40], bank.elevation[40])
