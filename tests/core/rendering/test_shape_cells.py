"""The cells of single shapes hold every visible point of them, and little else."""

import pytest
import torch

from core.geometry.rays import cast_rays
from core.metrics import psnr_from_mse
from core.models.library import load_model
from core.rendering.importance import render_top_samples
from core.rendering.shape_cells import shape_cells
from tests.conftest import random_model


@pytest.mark.parametrize("name", ["chairs", "cars"])
@pytest.mark.parametrize("seed", range(3))
def test_a_render_within_the_cells_of_its_shape_looks_the_same(name: str, seed: int):
    model = load_model(name)
    generator = torch.Generator().manual_seed(seed)
    rows = torch.randperm(len(model.codes.shapes), generator=generator)[:4]
    shape, texture = model.field.biases(model.codes.shapes[rows], model.codes.textures[:4])
    cells = shape_cells(model, shape)
    assert bool((cells <= model.occupied_cells).all())
    assert float(cells.float().mean()) < 0.6 * float(model.occupied_cells.float().mean())
    pixels = torch.rand((4, 1, 300, 2), generator=generator) * 0.4 - 0.2
    angles = torch.rand((4, 1, 1), generator=generator)
    rays = cast_rays(
        pixels, 6 * angles, angles, torch.full_like(angles, model.distance), 1.0, (0, 0), model.extent_tensor
    )
    with torch.no_grad():
        full = render_top_samples(model, rays, 48, 12, shape, texture)
        within_cells = render_top_samples(model, rays, 48, 12, shape, texture, cells)
    for channels in (slice(0, 3), slice(3, 4)):
        assert psnr_from_mse(float((full - within_cells)[..., channels].square().mean())) > 40


def test_a_model_whose_network_paints_the_background_has_no_cells():
    model = random_model(white_from_network=True)
    assert model.occupied_cells is None
    assert shape_cells(model, model.field.shape_bias(model.codes.shapes)) is None
