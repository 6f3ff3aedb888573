from dataclasses import replace

import numpy as np
import pytest
import torch

from core.detail.progressive import Frame
from core.edits.bend import Bend
from core.edits.stretch import Stretch
from core.models.codes import Entry
from core.models.model import Instance, Model, Words
from tests.conftest import open_models, random_model
from viewer.activities.direction_words import DirectionWords
from viewer.activities.names import Names
from viewer.activities.thumbnails import Thumbnails
from viewer.editor import Editor
from viewer.values.history import Pair
from viewer.values.objects import EditableObject


class Painted(Thumbnails):
    """Thumbnails in the colours of objects, grey by default."""

    def __init__(self) -> None:
        self.colours: dict[Instance, tuple[int, int, int]] = {}
        self.frames: dict[Instance, Frame] = {}

    def of_object(self, instance: Instance, size: int = 8, samples: int = 8) -> Frame | None:
        if instance not in self.frames:
            image = np.full((size, size, 3), self.colours.get(instance, (128, 128, 128)), np.uint8)
            opaque = np.ones((size, size), np.float32)
            self.frames[instance] = Frame(image, opaque, opaque, 0, 1, samples, 0.0)
        return self.frames[instance]


class Worded(DirectionWords):
    """The same words for every model."""

    def __init__(self) -> None:
        pass

    def of_model(self, model: Model) -> Words:
        return Words(shape=("wider", "taller"), texture=())


@pytest.fixture
def chairs() -> Model:
    model = replace(random_model(), category="chairs")
    names = ("infinigen_chair_0103", "infinigen_chair_0103-form1", "kenney_chair_desk", *"def")
    objects = tuple(Entry(name, index, index) for index, name in enumerate(names))
    return replace(model, codes=replace(model.codes, objects=objects))


@pytest.fixture
def names(chairs: Model) -> Names:
    editor = Editor(open_models(chairs), chairs, torch.Generator())
    return Names(editor, Painted(), Worded())


def test_objects_named_by_their_kind_alone_get_their_colour_and_height(names: Names, chairs: Model) -> None:
    names._thumbnails.colours[chairs[1]] = (200, 30, 40)
    assert names.label("infinigen_chair_0103") == "Low grey chair"
    assert names.caption("infinigen_chair_0103") == "Low grey"
    assert names.label("infinigen_chair_0103-form1") == "Low red chair, form 1"
    assert names.label("kenney_chair_desk") == "Chair desk" and names.label("gone") == "gone"
    assert names.pair(Pair("kenney_chair_desk", "infinigen_chair_0103")) == "Chair desk as Low grey chair"


def test_versions_are_named_by_what_differs_and_a_persons_name_wins(names: Names, chairs: Model) -> None:
    objects = names._editor.objects
    space = chairs.codes.shape_space
    fitted = chairs[2]
    red = fitted.changed(texture=fitted.codes.texture + 0.1)
    low = red.moved("shape", -0.5 * space.basis[1])
    names._thumbnails.colours = {red: (200, 30, 40), low: (200, 30, 40)}
    name = objects.add(EditableObject("Car", fitted, True))
    assert names.version(name, fitted) == "as fitted" and names.label(name) == "Car"
    assert names.version(name, red) == "red"
    assert names.version(name, low) == "red, lower"
    assert names.version(name, fitted.changed(texture=fitted.codes.texture + 0.2)) == "repainted"
    assert names.version(name, fitted.with_edits(Stretch, Stretch((1.2, 1.0, 1.0)))) == "resized"
    assert names.version(name, fitted.with_edits(Bend, Bend(-0.4, 0.0, 0.1, 0.4))) == "resized"
    version = objects.version(name, low)
    assert names.label(version) == "Car, red, lower"
    objects.rename(version, "My own")
    assert names.version(name, low) == "My own"
    assert names.pair(Pair(objects.named(name, low)[0], objects.named(name, low)[0])) == "My own"
