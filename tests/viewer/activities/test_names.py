from dataclasses import replace

import pytest
import torch

from core.edits.bend import Bend
from core.edits.paint import PartPaint
from core.edits.stretch import Stretch
from core.models.codes import Entry
from core.models.model import Model, Words
from tests.conftest import open_models, random_model
from viewer.activities.names import Names
from viewer.editor import Editor
from viewer.values.objects import EditableObject
from viewer.values.state import Pair


def same_words(model: Model) -> Words:
    """The same words for every model."""
    return Words(shape=("wider", "taller"), texture=("redder",))


@pytest.fixture
def chairs() -> Model:
    model = replace(random_model(), category="chairs")
    names = ("infinigen_chair_0103", "infinigen_chair_0103-form1", "kenney_chair_desk", *"def")
    objects = tuple(Entry(name, index, index) for index, name in enumerate(names))
    return replace(model, codes=replace(model.codes, objects=objects))


@pytest.fixture
def names(chairs: Model) -> Names:
    editor = Editor(open_models(chairs), chairs, torch.Generator())
    return Names(editor, same_words)


def test_objects_have_the_names_of_their_meshes(names: Names) -> None:
    assert names.label("infinigen_chair_0103") == names.caption("infinigen_chair_0103") == "Chair 103"
    assert names.label("infinigen_chair_0103-form1") == "Chair 103, form 1"
    assert names.label("kenney_chair_desk") == "Chair desk" and names.label("gone") == "gone"
    assert names.pair(Pair("kenney_chair_desk", "infinigen_chair_0103")) == "Chair desk as Chair 103"


def test_versions_are_named_by_what_differs_and_a_persons_name_wins(names: Names, chairs: Model) -> None:
    objects = names._editor.objects
    space = chairs.codes.shape_space
    fitted = chairs[2]
    red = fitted.with_edits(PartPaint, PartPaint("seat", (0.78, 0.12, 0.16), (0.5, 0.5, 0.5)))
    low = red.moved("shape", -0.5 * space.basis[1])
    name = objects.add(EditableObject("Car", fitted, True))
    assert names.version(name, fitted) == "as fitted" and names.label(name) == "Car"
    assert names.version(name, red) == "red"
    assert names.version(name, low) == "red, lower"
    assert names.version(name, fitted.moved("texture", chairs.codes.texture_space.basis[0])) == "redder"
    assert names.version(name, fitted.moved("texture", chairs.codes.texture_space.basis[1])) == "repainted"
    assert names.version(name, fitted.with_edits(Stretch, Stretch((1.2, 1.0, 1.0)))) == "resized"
    assert names.version(name, fitted.with_edits(Bend, Bend(-0.4, 0.0, 0.1, 0.4))) == "resized"
    version = objects.version(name, low)
    assert names.label(version) == "Car, red, lower"
    objects.rename(version, "My own")
    assert names.version(name, low) == "My own"
    assert names.pair(Pair(objects.named(name, low)[0], objects.named(name, low)[0])) == "My own"
