from dataclasses import replace

import pytest
import torch

from core.lab.training.parts import fit_part_head, labelled_places
from core.models.library import load_model
from core.models.model import Model


@pytest.mark.parametrize("category", ["cars", "chairs"])
def test_a_head_fitted_to_a_few_objects_labels_another_one(category: str):
    model = load_model(category)
    assert model.part_head
    *training, (features, labels) = labelled_places(replace(model, part_head=None), model, 6)
    training_labels = torch.cat([labels for _, labels in training])
    assert set(training_labels.tolist()) == set(range(len(model.part_head.names)))
    head = fit_part_head(model.part_head.names, training)
    assert float((head(features).argmax(1) == labels).float().mean()) > 0.75


def test_teachers_without_a_part_head_or_a_common_object_are_refused(tiny: Model):
    with pytest.raises(ValueError, match="no part head"):
        next(labelled_places(tiny, tiny, 2))
    with pytest.raises(ValueError, match="no common object"):
        next(labelled_places(tiny, load_model("cars"), 2))
