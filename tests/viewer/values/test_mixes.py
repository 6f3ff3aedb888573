import numpy as np

from core.models.model import Model
from viewer.values.mixes import STEPS, mixes


def test_shapes_go_to_the_right_and_textures_upwards(model: Model) -> None:
    a = model[1]
    b = model[2]
    grid = mixes(a, b)
    assert len(grid) == STEPS**2
    assert grid[0, 0] == a and grid[STEPS - 1, STEPS - 1] == b
    np.testing.assert_allclose(grid[STEPS - 1, 0].codes.shape, b.codes.shape, atol=1e-6)
    np.testing.assert_allclose(grid[0, STEPS - 1].codes.texture, b.codes.texture, atol=1e-6)
