from dataclasses import replace

import numpy as np
import pytest

from core.detail.progressive import Frame, render_frame
from core.models.model import Model
from viewer.values.influence import CodeInfluence


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
    influence = CodeInfluence.between(frame, replace(frame, image=image))
    assert influence.leak == 0.0
    assert influence.image[3, 3].sum() > influence.image[5, 5].sum() + 300
    assert (influence.image[5, 5] == influence.image[0, 0]).all()
    influence = CodeInfluence.between(frame, frame)
    assert influence.leak == 0.0
    assert (influence.image[..., 3] == 0).all()


def test_texture_leaves_the_silhouette_exactly_and_shape_moves_it(model: Model) -> None:
    camera = model.camera(0.4, 0.3).resized(24, 24)
    first = model[0]
    second = model[1]
    before = render_frame(first, camera)
    repainted = CodeInfluence.between(before, render_frame(first.with_texture(second), camera))
    reshaped = CodeInfluence.between(before, render_frame(first.with_shape(second), camera))
    assert repainted.leak == 0.0
    assert repainted.image.std() > 0
    assert reshaped.leak > 0
