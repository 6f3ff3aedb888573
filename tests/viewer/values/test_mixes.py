import numpy as np

from core.models.model import Model
from viewer.values.mixes import STEPS, mixes


def test_shapes_go_to_the_right_and_textures_upwards(model: Model) -> None:
    a, b = model[1], model[2]
    found = mixes(a, b)
    assert len(found) == STEPS**2
    assert found[0, 0] == a and found[STEPS - 1, STEPS - 1] == b
    np.testing.assert_allclose(found[STEPS - 1, 0].codes.shape, b.codes.shape, atol=1e-6)
    np.testing.assert_allclose(found[0, STEPS - 1].codes.texture, b.codes.texture, atol=1e-6)
