"""Rendering for fits against the exact renderer: equal with all samples, close with the largest weights."""

import pytest
import torch
from torch import Tensor

from core.geometry.camera import camera_rotation
from core.geometry.rays import Rays, cast_rays
from core.models.model import Model
from core.rendering.importance import render_top_samples
from core.rendering.reference import render_rays
from core.runtime.precision import use_dtype
from tests.conftest import random_model


def bundle(model: Model, objects: int, rays: int) -> Rays:
    """Rays of (objects, 2 views, rays) from all sides."""
    generator = torch.Generator().manual_seed(1)
    pixels = torch.rand((objects, 2, rays, 2), generator=generator) * 0.3 - 0.15
    angles = torch.rand((objects, 2, 1), generator=generator)
    distance = torch.full((objects, 2, 1), model.distance)
    return cast_rays(pixels, 6 * angles, angles, distance, 1.0, (0, 0), model.extent_tensor)


def biases(model: Model, objects: int) -> tuple[Tensor, Tensor]:
    shape = model.field.shape_bias(model.codes.shapes[:objects]).detach().requires_grad_()
    return shape, model.field.texture_bias(model.codes.textures[:objects]).detach().requires_grad_()


@pytest.mark.parametrize("white_from_network", [False, True])
def test_with_all_samples_the_render_is_exact(white_from_network: bool) -> None:
    model = random_model(white_from_network=white_from_network)
    rays = bundle(model, 3, 20)
    shape, texture = biases(model, 3)
    colour, opacity = render_top_samples(model, rays, 12, 12, shape, texture).split((3, 1), -1)
    plain = render_rays(model, rays, 12, shape[:, None, None, None], texture[:, None, None, None])
    torch.testing.assert_close(colour, plain.colour)
    torch.testing.assert_close(opacity[..., 0], plain.opacity)
    ours = torch.autograd.grad(colour.square().sum() + opacity.sum(), (shape, texture))
    theirs = torch.autograd.grad(plain.colour.square().sum() + plain.opacity.sum(), (shape, texture))
    torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-5)


def test_opacity_is_exact_with_few_samples_and_rays_that_miss_are_white(model: Model) -> None:
    rays = bundle(model, 2, 30)
    shape, texture = biases(model, 2)
    exact = render_rays(model, rays, 16, shape[:, None, None, None], texture[:, None, None, None])
    errors = []
    for coloured in (1, 4, 10):
        colour, opacity = render_top_samples(model, rays, 16, coloured, shape, texture).split((3, 1), -1)
        torch.testing.assert_close(opacity[..., 0], exact.opacity)
        errors.append(float((colour - exact.colour).abs().mean().detach()))
    assert errors[0] > errors[1] > errors[2]
    turn = camera_rotation(torch.tensor(0.0), torch.tensor(0.0))
    origins = (turn @ torch.tensor([0.0, 0.0, 5.0])).expand(1, 1, 4, 3)
    nothing = torch.zeros(1, 1, 4)
    rays = Rays(origins, origins / 5, nothing, nothing)
    rendered = render_top_samples(model, rays, 8, 2, *biases(model, 1))
    torch.testing.assert_close(rendered, torch.tensor([1.0, 1, 1, 0]).expand(1, 1, 4, 4))


def test_renders_with_and_without_gradients_agree(model: Model) -> None:
    rays = bundle(model, 2, 40)
    shape, texture = biases(model, 2)
    differentiable = render_top_samples(model, rays, 16, 5, shape, texture)
    with torch.no_grad(), use_dtype(torch.float32):
        plain = render_top_samples(model, rays, 16, 5, shape, texture)
    torch.testing.assert_close(plain, differentiable, rtol=0, atol=5e-3)
