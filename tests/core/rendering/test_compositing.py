import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from core.rendering.compositing import composite_on_white, compositing_weights


def by_hand(density: list[float], edges: list[float]) -> tuple[list[float], float]:
    """The paper's loop: the weight of each interval, and the light left over."""
    light = 1.0
    weights = []
    for sigma, start, end in zip(density, edges[:-1], edges[1:], strict=True):
        absorbed = 1 - math.exp(-sigma * (end - start))
        weights.append(light * absorbed)
        light *= 1 - absorbed
    return weights, light


@given(st.lists(st.tuples(st.floats(0, 50), st.floats(0, 1)), min_size=1, max_size=20))
def test_weights_are_those_of_the_loop_in_the_paper(pairs):
    density = [sigma for sigma, _ in pairs]
    edges = [0.0]
    for _, length in pairs:
        edges.append(edges[-1] + length)
    weights, left = compositing_weights(
        torch.tensor(density, dtype=torch.float64), torch.tensor(edges, dtype=torch.float64)
    )
    expected, remaining = by_hand(density, edges)
    torch.testing.assert_close(weights, torch.tensor(expected, dtype=torch.float64), atol=1e-9, rtol=1e-9)
    assert float(left) == pytest.approx(remaining, abs=1e-9)


@pytest.mark.parametrize("sigma", [0.0, 1e-10, 1.0, 1e10, 1e30])
@pytest.mark.parametrize("length", [0.0, 1e-10, 1.0, 1e8])
def test_extremes_are_finite_and_so_are_their_gradients(sigma: float, length: float):
    density = torch.full((3, 5), sigma, requires_grad=True)
    edges = (torch.arange(6) * length).expand(3, 6)
    weights, left = compositing_weights(density, edges)
    assert bool((weights >= 0).all() and torch.isfinite(weights).all())
    torch.testing.assert_close(weights.sum(-1) + left, torch.ones(3))
    (weights.sum() + 2 * left.sum()).backward()
    assert bool(torch.isfinite(density.grad).all())


def test_gradients_match_differences_and_transmitted_light_is_white():
    density = torch.rand(2, 6, dtype=torch.float64, requires_grad=True)
    edges = torch.linspace(0, 1, 7, dtype=torch.float64).expand(2, 7)
    assert torch.autograd.gradcheck(lambda sigma: compositing_weights(sigma, edges), (density,))
    weights, left = compositing_weights(torch.zeros(4), torch.linspace(0, 1, 5))
    assert composite_on_white(weights, left, torch.zeros(4, 3)).tolist() == [1, 1, 1]
