import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from core.edits.stretch import MAX_DISTORTION, Stretch
from core.geometry.camera import Factors

_FACTORS = st.tuples(*[st.floats(0.5, 4.0)] * 3)


@pytest.mark.parametrize("factors", [(0.0, 1.0, 1.0), (1.0, -1.0, 1.0), (torch.nan,) * 3, (1e3,) * 3, (1.0, 20.0, 1.0)])
def test_other_stretches_are_refused(factors: Factors):
    with pytest.raises(ValueError, match="times"):
        Stretch(factors)


@given(_FACTORS, _FACTORS, st.integers(0, 2), st.floats(0, 1), st.sampled_from((1e-9, 1e9)))
def test_stretches_made_from_others_at_their_limits_are_valid(
    first: Factors, second: Factors, axis: int, amount: float, factor: float
):
    ends = (Stretch(factors).with_side(axis, factor) for factors in (first, second))
    mixed = Stretch.between(*ends, amount).factors
    assert max(mixed) <= 1.00001 * MAX_DISTORTION * min(mixed)


def test_points_come_from_where_they_are_led():
    stretch = Stretch((2.0, 1.0, 0.5))
    points = torch.rand(9, 3)
    torch.testing.assert_close(stretch.origins(stretch.destinations(points)), points)
