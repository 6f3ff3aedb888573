from dataclasses import replace

import pytest
import torch

from core.geometry.camera import camera_rotation
from core.models.library import load_model
from core.models.model import Model
from core.models.view_bank import SIDE, unpack_bits
from core.photos.view_bank import apparent_size, build_view_bank, view_bank
from core.rendering.reference import render_exact
from core.rendering.surface import surface_points
from tests.conftest import random_model, with_contrast
from tests.core.fitting.inputs import problem_of
from tests.core.tiny import photo_of, tiny_bank


def test_apparent_sizes_are_those_in_training_images(tiny: Model):
    usual = apparent_size(tiny_bank(), tiny)
    silhouette = render_exact(tiny[0], tiny.camera(0.7, 0.4), 32).opacity > 0.5
    size = max(int(silhouette.any(0).sum()), int(silhouette.any(1).sum())) / tiny.image_size
    assert usual.min < size < usual.max


def test_a_view_equals_a_plain_loop_over_the_points(tiny: Model):
    bank = tiny_bank()
    view = 2 * 24 + 3
    index = 1
    instance = tiny.mean.changed(shape=bank.shapes(tiny.codes)[index])
    points, _ = surface_points(instance)
    turned = (points @ camera_rotation(bank.azimuth[view], bank.elevation[view]).T).tolist()
    projected = [(x / (tiny.distance - z), -y / (tiny.distance - z)) for x, y, z in turned]
    low, high = (tuple(map(end, zip(*projected, strict=True))) for end in (min, max))
    size = max(high[0] - low[0], high[1] - low[1])
    mask = torch.zeros(SIDE, SIDE)
    for point in projected:
        column, row = (
            min(SIDE - 1, int((value - (lowest + highest) / 2) / size * (SIDE - 2) + SIDE / 2))
            for value, lowest, highest in zip(point, low, high, strict=True)
        )
        mask[row, column] = 1
    assert float(bank.sizes[index, view]) == pytest.approx(size, rel=1e-3)
    assert bank.offsets[index, view].tolist() == pytest.approx(
        [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2], abs=1e-4
    )
    silhouette = unpack_bits(bank.silhouettes[index, view : view + 1]).reshape(SIDE, SIDE)
    assert float((silhouette != mask).float().mean()) < 0.01  # a point between two pixels may be rounded either way


def test_a_bank_is_built_once_with_progress_up_to_one(tiny: Model):
    model = replace(tiny)  # a model that has none yet
    fractions = list(build_view_bank(model))
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert not list(build_view_bank(model))
    assert view_bank(model) is view_bank(model)


@pytest.mark.parametrize("name", ["chairs", "cars"])
def test_shipped_models_are_complete(name: str):
    model = load_model(name)
    assert view_bank(model) is model.view_bank is not None and model.words is not None
    assert not list(build_view_bank(model))
    number = len(model.view_bank.prototypes) // 2
    shape = model.view_bank.shapes(model.codes)[number]
    points, _ = surface_points(model.mean.changed(shape=shape))
    right, _, backward = camera_rotation(model.view_bank.azimuth[30], model.view_bank.elevation[30]) @ points.T
    projected_x = right / (model.distance - backward)
    middle = float(projected_x.max() + projected_x.min()) / 2
    assert float(model.view_bank.offsets[number, 30, 0]) == pytest.approx(middle, abs=0.01)


def test_a_fit_through_the_soft_field_uses_the_bank_of_the_model(tiny: Model):
    sharp = with_contrast(tiny)
    photo = photo_of(sharp[0], sharp.camera(0.5, 0.5))
    assert problem_of(sharp, photo).bank is view_bank(sharp)


def test_an_empty_bank_is_refused_where_it_is_used():
    empty = random_model()
    empty.field.density_layer.bias.fill_(-1e4)
    with pytest.raises(ValueError, match="no objects"):
        apparent_size(view_bank(empty), empty)
