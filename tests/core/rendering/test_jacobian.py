"""The Jacobian by hand against autograd, and against the renderer it belongs to."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
import torch
from torch import Tensor
from torch.nn.functional import pad

from core.geometry.rays import Rays
from core.models.model import Model
from core.rendering import jacobian as jacobians
from core.rendering.jacobian import BiasJacobians, RenderedJacobian, render_with_jacobian
from core.rendering.reference import render_rays
from core.runtime.precision import use_dtype
from tests.conftest import random_model, with_contrast
from tests.core.rendering.test_importance import bundle

OBJECTS, RAYS, SAMPLES = 3, 10, 12


@pytest.fixture(autouse=True)
def single() -> Iterator[None]:
    """In float32, so that derivatives can be compared."""
    with use_dtype(torch.float32):
        yield


def biases(model: Model) -> tuple[Tensor, Tensor]:
    return model.field.shape_bias(model.codes.shapes[:OBJECTS]), model.field.texture_bias(
        model.codes.textures[:OBJECTS]
    )


def entries(model: Model, numbers: int) -> BiasJacobians:
    """Random directions in which biases move."""
    generator = torch.Generator().manual_seed(5)
    shape, texture = biases(model)
    return BiasJacobians(
        torch.randn(*shape.shape, numbers, generator=generator), torch.randn(*texture.shape, 2, generator=generator)
    )


def traced(model: Model, kept: int = SAMPLES) -> tuple[Rays, BiasJacobians, RenderedJacobian]:
    rays, enter = bundle(model, OBJECTS, RAYS), entries(model, 3)
    return rays, enter, render_with_jacobian(model, rays, SAMPLES, kept, *biases(model), enter)


@pytest.mark.parametrize(("white_from_network", "contrast"), [(False, 0.0), (True, 0.0), (False, 20.0)])
def test_with_all_samples_kept_it_is_the_exact_renderer_and_its_jacobian(white_from_network: bool, contrast: float):
    model = with_contrast(random_model(white_from_network=white_from_network), contrast)
    rays, enter, found = traced(model)
    origins, directions = (part.detach().clone().requires_grad_() for part in (rays.origins, rays.directions))
    shape, texture = (part[:, None, None, None].detach().requires_grad_() for part in biases(model))
    seen = render_rays(model, replace(rays, origins=origins, directions=directions), SAMPLES, shape, texture)
    channels = (*seen.colour.unbind(-1), seen.opacity)
    torch.testing.assert_close(found.channels, torch.stack(channels, -1), rtol=1e-4, atol=1e-5)
    for index, channel in enumerate(channels):
        origin, direction, by_shape, by_texture = torch.autograd.grad(
            channel.sum(), (origins, directions, shape, texture), retain_graph=True, materialize_grads=True
        )
        torch.testing.assert_close(found.origin[..., index, :], origin, rtol=1e-3, atol=1e-4)
        torch.testing.assert_close(found.direction[..., index, :], direction, rtol=1e-3, atol=1e-4)
        for ours, slope, entry in (
            (found.shape, by_shape, enter.shape),
            (pad(found.texture, (0, 0, 0, 1)), by_texture, enter.texture),
        ):
            along = (slope.flatten(1)[..., None] * entry.flatten(1, 2)).sum(1)
            torch.testing.assert_close(ours[..., index, :].sum((1, 2)), along, rtol=1e-3, atol=1e-3)


def test_numbers_of_their_own_are_those_of_a_diagonal_jacobian(model: Model):
    rays = bundle(model, OBJECTS, RAYS)
    scales = BiasJacobians(*(torch.rand_like(bias) for bias in biases(model)))
    diagonal = BiasJacobians(*(torch.diag_embed(scale.flatten(1)).unflatten(1, scale.shape[1:]) for scale in scales))
    direct, mapped = (
        render_with_jacobian(model, rays, SAMPLES, 4, *biases(model), moves) for moves in (scales, diagonal)
    )
    for ours, expected in zip(direct, mapped, strict=True):
        torch.testing.assert_close(ours, expected, rtol=1e-5, atol=1e-6)


def test_few_samples_tell_most_and_chunks_do_not_matter(model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    _, _, whole = traced(model)
    _, _, some = traced(model, 4)
    for name in ("channels", "origin", "shape"):
        one, other = getattr(whole, name).flatten(), getattr(some, name).flatten()
        assert float(torch.cosine_similarity(one, other, dim=0)) > 0.95
    _, _, whole = traced(model)
    monkeypatch.setattr(jacobians, "chunk_points", lambda _: 50)
    _, _, parts = traced(model)
    for one, other in zip(whole, parts, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-5)


def test_rays_that_miss_are_white_and_still() -> None:
    model = random_model()
    rays = bundle(model, OBJECTS, RAYS)
    away = replace(rays, far=rays.near)
    found = render_with_jacobian(model, away, SAMPLES, 4, *biases(model), entries(model, 3))
    assert bool((found.channels == torch.tensor([1, 1, 1, 0])).all())
    assert all(not bool(part.any()) for part in found[1:])
