import math

import pytest
import torch
from hypothesis import assume, given
from hypothesis import strategies as st

from core.edits.bend import MAX_BEND, Bend

_SHARES = st.floats(0.05, 0.95)


def bend_of(plane: float, moved: float) -> Bend:
    """A bend between -0.5 and 0.5 from and to shares of the height, as near as limits allow."""
    lowest = max(plane / MAX_BEND, 1 - MAX_BEND * (1 - plane))
    highest = min(plane * MAX_BEND, 1 - (1 - plane) / MAX_BEND)
    return Bend(-0.5, plane - 0.5, max(lowest, min(highest, moved)) - 0.5, 0.5)


def column(heights: torch.Tensor) -> torch.Tensor:
    return torch.stack((0.1 * torch.ones_like(heights), -0.2 * torch.ones_like(heights), heights), -1)


@given(_SHARES, _SHARES)
def test_a_bend_is_increasing_keeps_its_ends_and_is_undone(plane: float, moved: float):
    bend = bend_of(plane, moved)
    points = column(torch.linspace(-0.8, 0.8, 401, dtype=torch.double))
    origins = bend.origins(points)
    torch.testing.assert_close(bend.destinations(origins), points)
    assert torch.equal(origins[:, :2], points[:, :2])
    assert bool((origins[:, 2].diff() > 0.004 / MAX_BEND * 0.99).all())
    outside = points[:, 2].abs() >= 0.5
    assert torch.equal(origins[outside], points[outside])
    (plane_origin,) = bend.origins(column(torch.tensor([bend.moved], dtype=torch.double)))
    assert float(plane_origin[2]) == pytest.approx(bend.plane)


@given(_SHARES, _SHARES, _SHARES, _SHARES, st.floats(0, 1))
def test_bends_are_mixed_within_their_limits(first: float, to: float, second: float, end: float, amount: float):
    ends = bend_of(first, to), bend_of(second, end)
    assume(ends[0] != ends[1])
    (mixed,) = Bend.mixed(ends[:1], ends[1:], amount)
    assert mixed.moved == pytest.approx((1 - amount) * ends[0].moved + amount * ends[1].moved)
    half = Bend.between(None, ends[1], amount)
    assert half.moved - half.plane == pytest.approx(amount * (ends[1].moved - ends[1].plane))
    assert Bend.mixed(ends[:1], (), 0.0) == ends[:1] and Bend.mixed((), (), amount) == ()


@pytest.mark.parametrize(
    "heights",
    [
        (0.5, 0.0, 0.1, -0.5),
        (-0.5, -0.5, 0.1, 0.5),
        (-0.5, 0.0, 0.5, 0.5),
        (-0.5, -0.4, 0.0, 0.5),
        (-0.5, 0.4, 0.0, 0.5),
        (-0.5, math.nan, 0.0, 0.5),
        (-math.inf, 0.0, 0.1, 0.5),
    ],
)
def test_other_bends_are_refused_in_one_line(heights: tuple[float, float, float, float]):
    with pytest.raises(ValueError, match=r"^a bend [^\n]*$"):
        Bend(*heights)
