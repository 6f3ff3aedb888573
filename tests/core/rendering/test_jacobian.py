"""The hand-written Jacobian against autograd through the exact renderer."""

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
from tests.core.rendering.test_importance import biases, bundle

OBJECTS, RAYS, SAMPLES = 3, 10, 12


@pytest.fixture(autouse=True)
def float32() -> Iterator[None]:
    """Compute in float32, so that derivatives can be compared."""
    with use_dtype(torch.float32):
        yield


def random_jacobians(model: Model, numbers: int) -> BiasJacobians:
    """Random derivatives of the shape biases by this many numbers, and of the texture biases by two."""
    generator = torch.Generator().manual_seed(5)
    shape, texture = biases(model, OBJECTS)
    return BiasJacobians(
        torch.randn(*shape.shape, numbers, generator=generator), torch.randn(*texture.shape, 2, generator=generator)
    )


def rendered(model: Model, coloured: int = SAMPLES) -> tuple[Rays, BiasJacobians, RenderedJacobian]:
    rays = bundle(model, OBJECTS, RAYS)
    moves = random_jacobians(model, 3)
    return rays, moves, render_with_jacobian(model, rays, SAMPLES, coloured, *biases(model, OBJECTS), moves)


def with_opacity(by_texture: Tensor) -> Tensor:
    """Derivatives of all channels by the texture, which does not change opacity."""
    return pad(by_texture, (0, 0, 0, 1))


@pytest.mark.parametrize(("white_from_network", "contrast"), [(False, 0.0), (True, 0.0), (False, 20.0)])
def test_with_all_samples_channels_and_jacobian_are_those_of_autograd(white_from_network: bool, contrast: float):
    model = with_contrast(random_model(white_from_network=white_from_network), contrast)
    rays, moves, jacobian = rendered(model)
    origins, directions = (values.detach().clone().requires_grad_() for values in (rays.origins, rays.directions))
    shape, texture = (bias[:, None, None, None].detach().requires_grad_() for bias in biases(model, OBJECTS))
    exact = render_rays(model, replace(rays, origins=origins, directions=directions), SAMPLES, shape, texture)
    channels = (*exact.colour.unbind(-1), exact.opacity)
    torch.testing.assert_close(jacobian.channels, torch.stack(channels, -1), rtol=1e-4, atol=1e-5)
    for index, channel in enumerate(channels):
        origin, direction, by_shape, by_texture = torch.autograd.grad(
            channel.sum(), (origins, directions, shape, texture), retain_graph=True, materialize_grads=True
        )
        torch.testing.assert_close(jacobian.origin[..., index, :], origin, rtol=1e-3, atol=1e-4)
        torch.testing.assert_close(jacobian.direction[..., index, :], direction, rtol=1e-3, atol=1e-4)
        by_codes = (jacobian.shape, by_shape, moves.shape), (with_opacity(jacobian.texture), by_texture, moves.texture)
        for ours, slope, move in by_codes:
            expected = (slope.flatten(1)[..., None] * move.flatten(1, 2)).sum(1)
            torch.testing.assert_close(ours[..., index, :].sum((1, 2)), expected, rtol=1e-3, atol=1e-3)


def test_biases_with_numbers_of_their_own_are_a_diagonal_jacobian(model: Model):
    rays = bundle(model, OBJECTS, RAYS)
    generator = torch.Generator().manual_seed(6)
    scales = BiasJacobians(*(torch.rand(bias.shape, generator=generator) for bias in biases(model, OBJECTS)))
    diagonals = BiasJacobians(*(torch.diag_embed(scale.flatten(1)).unflatten(1, scale.shape[1:]) for scale in scales))
    ours, expected = (
        render_with_jacobian(model, rays, SAMPLES, 4, *biases(model, OBJECTS), moves) for moves in (scales, diagonals)
    )
    for derivative, mapped in zip(ours, expected, strict=True):
        torch.testing.assert_close(derivative, mapped, rtol=1e-5, atol=1e-6)


def test_few_samples_give_similar_derivatives_and_chunks_the_same(
    model: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, _, complete = rendered(model)
    _, _, sparse = rendered(model, 4)
    for name in ("channels", "origin", "shape"):
        similarity = torch.cosine_similarity(getattr(complete, name).flatten(), getattr(sparse, name).flatten(), dim=0)
        assert float(similarity) > 0.95
    monkeypatch.setattr(jacobians, "chunk_points", lambda _: 50)
    _, _, chunked = rendered(model)
    for values, expected in zip(chunked, complete, strict=True):
        torch.testing.assert_close(values, expected, rtol=1e-4, atol=1e-5)


def test_rays_that_miss_are_white_and_have_no_derivatives() -> None:
    model = random_model()
    rays = bundle(model, OBJECTS, RAYS)
    missing = replace(rays, far=rays.near)
    jacobian = render_with_jacobian(model, missing, SAMPLES, 4, *biases(model, OBJECTS), random_jacobians(model, 3))
    assert bool((jacobian.channels == torch.tensor([1, 1, 1, 0])).all())
    assert all(not bool(derivative.any()) for derivative in jacobian[1:])
