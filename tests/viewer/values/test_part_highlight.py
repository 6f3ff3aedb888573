import numpy as np
import pytest

from viewer.values.part_highlight import part_highlight


@pytest.mark.parametrize("shade", [0, 128, 255])
def test_a_glow_covers_its_part_and_is_visible_on_any_shade(shade: int) -> None:
    mask = np.zeros((32, 48), bool)
    mask[8:24, 12:24] = True
    glow = part_highlight(mask, np.ones((64, 96), np.float32)).astype(float)
    alpha = glow[..., 3:] / 255
    image = shade * (1 - alpha) + glow[..., :3] * alpha
    difference = np.abs(image - shade).max(-1)
    assert difference[20:44, 28:44].min() > 15
    assert difference[14:50, 22:50].max() > 90  # the line
    assert glow[:10, ..., 3].max() == glow[:, 60:, 3].max() == 0


def test_a_glow_ends_with_the_object() -> None:
    opacity = np.ones((64, 64), np.float32)
    opacity[:, 40:] = 0.0
    glow = part_highlight(np.ones((64, 64), bool), opacity)
    assert glow[:, :36, 3].min() > 40
    assert glow[:, 44:, 3].max() == 0
