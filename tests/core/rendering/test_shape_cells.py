"""Single shapes: their cells hold all of them that counts, and little else."""

import torch

from core.geometry.rays import cast_rays
from core.models.model import Model
from core.rendering.importance import render_top_samples
from core.rendering.shape_cells import shape_cells
from tests.conftest import random_model


def test_a_render_within_the_cells_of_its_shape_is_the_same(tiny: Model):
    shape, texture = tiny.field.biases(tiny.codes.shapes, tiny.codes.textures)
    cells, generator = shape_cells(tiny, shape), torch.Generator().manual_seed(0)
    assert cells is not None
    assert tiny.occupied_cells is not None
    assert bool((cells <= tiny.occupied_cells).all())
    assert float(cells.float().mean()) < float(tiny.occupied_cells.float().mean())
    places = torch.rand((len(shape), 1, 300, 2), generator=generator) * 0.4 - 0.2
    angles = torch.rand((len(shape), 1, 1), generator=generator)
    distance = torch.full_like(angles, tiny.distance)
    rays = cast_rays(places, 6 * angles, angles, distance, 1.0, (0, 0), tiny.extent_tensor)
    with torch.no_grad():
        whole, inside = (render_top_samples(tiny, rays, 48, 12, shape, texture, some) for some in (None, cells))
    for one, other in zip(whole, inside, strict=True):
        assert float((one - other).square().mean()) < 1e-5


def test_where_the_network_paints_the_background_there_are_none():
    model = random_model(white_from_network=True)
    assert model.occupied_cells is None
    assert shape_cells(model, model.field.shape_bias(model.codes.shapes)) is None
