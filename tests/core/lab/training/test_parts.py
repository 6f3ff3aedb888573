from dataclasses import replace

import pytest
import torch

from core.lab.datasets.procedural.table import shape_of
from core.lab.training.parts import PARTS, fit_part_head, labelled_places
from core.models.library import load_model
from core.models.model import Model


@pytest.mark.parametrize("category", list(PARTS))
def test_a_head_learns_the_parts_of_a_few_objects_and_knows_those_of_another(category: str):
    model = load_model(category)
    *learned, tested = labelled_places(model, 8)
    head = fit_part_head(model, learned)
    assert head.names == PARTS[category]
    features, part = tested
    assert set(torch.cat([one for _, one in learned]).tolist()) == set(range(len(head.names)))
    right = float((head(features).argmax(1) == part).float().mean())
    known = float((model.part_head(features).argmax(1) == part).float().mean()) if model.part_head else 0.0
    assert min(right, known) > 0.75, (right, known)


@pytest.mark.parametrize("seed", range(0, 60, 3))
def test_generated_objects_say_what_their_parts_belong_to(seed: int):
    named = {part.of for part in shape_of("chairs", seed).parts}
    assert named <= {*PARTS["chairs"], "shell"} and "legs" in named
    assert {part.of for part in shape_of("cars", seed).parts} == {"", "wheels"}


def test_what_has_no_known_parts_is_refused(tiny: Model):
    with pytest.raises(ValueError, match="for cars and chairs only"):
        next(labelled_places(tiny, 2))
    with pytest.raises(ValueError, match="not trained on generated objects"):
        next(labelled_places(replace(tiny, category="cars"), 2))
