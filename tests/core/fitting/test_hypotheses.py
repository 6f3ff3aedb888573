import math
from dataclasses import replace

import pytest
import torch

from core.fitting.hypotheses import (
    HypothesisBatch,
    by_loss,
    clamp_parameters,
    concatenate,
    mean_parameters,
    other_basins,
    to_cameras,
)
from core.geometry.camera import Camera
from tests.core.fitting.inputs import random_parameters, standing
from tests.core.tiny import tiny_model


def test_a_longer_focal_length_keeps_the_apparent_size():
    camera = Camera(0.0, 0.0, 1.3, 131.25, 128, 128)
    model = replace(tiny_model(), distance=1.3)
    near, far = (to_cameras(model, standing(0.1, zoom=zoom), 0, [camera])[0] for zoom in (0.0, 0.4))
    assert far.focal == pytest.approx(near.focal * math.exp(0.4))
    assert far.focal / far.distance == pytest.approx(near.focal / near.distance)


@pytest.mark.parametrize("millimetres", [13, 24, 160])
def test_usual_lenses_are_within_the_searched_range(millimetres: float):
    """The models' images are of a lens of 37 mm."""
    parameters = standing(0.0, zoom=math.log(millimetres / 37))
    assert torch.equal(clamp_parameters(parameters, torch.tensor([True])).zoom, parameters.zoom)


def test_other_basins_have_their_best_hypothesis_each():
    batch = HypothesisBatch.of(random_parameters(5))
    views = torch.tensor([True])
    batch.parameters.angles[:, 0] = torch.tensor([[0.0, 0.2], [0.1, 0.2], [2.0, 0.2], [2.1, 0.2], [4.0, 0.2]])
    batch = replace(batch, loss=torch.tensor([1.0, 2.0, 5.0, 4.0, 3.0]))
    assert other_basins(batch, batch.best, views).origin.tolist() == [4, 3]
    assert not len(other_basins(batch[torch.tensor([0, 1])], batch.best, views))
    lost = replace(batch, loss=torch.tensor([1.0, 2.0, 5.0, math.inf, math.inf]))
    assert other_basins(concatenate(lost, lost), batch.best, views).origin.tolist() == [2]


def test_diverged_hypotheses_neither_lead_nor_stay():
    batch = HypothesisBatch.of(random_parameters(3))
    assert batch[torch.tensor([2, 0])].origin.tolist() == [2, 0]
    costs = replace(batch, loss=torch.tensor([3.0, math.inf, 2.0]))
    assert costs.leader == 2
    with pytest.raises(ValueError, match="diverged"):
        _ = replace(batch, loss=torch.full((3,), math.inf)).leader
    assert by_loss(costs).tolist() == [2, 0]


def test_mean_parameters_keep_the_last_loss():
    first, second = (HypothesisBatch.of(random_parameters(2)) for _ in range(2))
    moved = replace(
        second, parameters=second.parameters._replace(shape=second.parameters.shape + 1), loss=torch.ones(2)
    )
    mean = mean_parameters([first, moved])
    torch.testing.assert_close(mean.parameters.shape, first.parameters.shape + 0.5)
    assert mean.loss.tolist() == [1, 1]
