import math

import pytest
import torch

from core.classifiers.viewpoint import SIDE, ViewpointClassifier
from core.lab.datasets.srn import Dataset
from core.lab.training import viewpoint
from core.lab.training.viewpoint import ViewpointDataset, accuracy_within, train_viewpoint, viewpoint_dataset
from tests.core.lab.evaluation.test_protocol import views_of
from tests.core.tiny import tiny_model


@pytest.fixture(scope="module")
def stools() -> ViewpointDataset:
    """Stools from all sides."""
    model = tiny_model()
    return viewpoint_dataset(
        Dataset(tuple(views_of(model, i, 5) for i in range(4)), "stools", model.image_size, model.focal)
    )


def test_every_image_has_its_direction_and_an_empty_dataset_is_refused(stools: ViewpointDataset):
    assert stools.images.shape == (20, 4, SIDE, SIDE)
    assert stools.images.dtype == torch.uint8
    assert stools.azimuth[:5].tolist() == pytest.approx([0.7 + 1.3 * turn for turn in range(5)])
    model = tiny_model()
    with pytest.raises(ValueError, match="every mask is empty"):
        viewpoint_dataset(Dataset((), "stools", model.image_size, model.focal))


def test_the_classifier_learns_directions_of_images(stools: ViewpointDataset, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(viewpoint, "BATCH_SIZE", 32)  # of twenty images
    torch.manual_seed(0)
    classifier = ViewpointClassifier()
    losses = list(train_viewpoint(classifier, stools, 100))
    assert len(losses) == 100
    assert losses[-1] < losses[0]
    assert accuracy_within(classifier, stools, math.radians(20)) > 0.5
    assert not classifier.training
