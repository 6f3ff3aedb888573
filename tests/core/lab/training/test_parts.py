from dataclasses import replace

import pytest
import torch

from core.lab.training.parts import fit_part_head, labelled_places
from core.models.library import load_model
from core.models.model import Model


@pytest.mark.parametrize("category", ["cars", "chairs"])
def test_a_head_learns_the_parts_of_a_few_objects_and_knows_those_of_another(category: str):
    model = load_model(category)
    assert model.part_head
    *learned, (features, part) = labelled_places(replace(model, part_head=None), model, 6)
    assert set(torch.cat([one for _, one in learned]).tolist()) == set(range(len(model.part_head.names)))
    head = fit_part_head(model.part_head.names, learned)
    assert float((head(features).argmax(1) == part).float().mean()) > 0.75


def test_models_that_cannot_teach_are_refused(tiny: Model):
    with pytest.raises(ValueError, match="no part head"):
        next(labelled_places(tiny, tiny, 2))
    with pytest.raises(ValueError, match="no common object"):
        next(labelled_places(tiny, load_model("cars"), 2))
