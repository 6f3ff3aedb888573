from dataclasses import replace

import numpy as np
import pytest

from core.detail.progressive import Frame
from viewer.values.influence import influence


@pytest.fixture
def frame() -> Frame:
    """A grey square."""
    opacity = np.zeros((8, 8), np.float32)
    opacity[2:6, 2:6] = 1
    image = np.where(opacity[..., None] > 0, 100, 255).astype(np.uint8).repeat(3, -1)
    return Frame(image, opacity, opacity, 0, 1, 8, 0.1)


def test_influence_is_at_pixels_that_change_alone(frame: Frame) -> None:
    image = frame.image.copy()
    image[2:4, 2:6, 0] = 160
    overlay = influence(frame, replace(frame, image=image))
    assert overlay[3, 3].sum() > overlay[5, 5].sum() + 300
    assert (overlay[5, 5] == overlay[0, 0]).all()
    assert (influence(frame, frame)[..., 3] == 0).all()
