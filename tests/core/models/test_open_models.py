from dataclasses import replace

import numpy as np
import pytest

from core.export.films import View
from core.export.video_frames import render_frames
from core.models.missing import MissingInstance
from core.models.model import Instance, Model
from core.models.open_models import OpenModels
from tests.conftest import open_models, random_model


@pytest.fixture
def cars() -> Model:
    return replace(random_model(5), category="cars")


def test_each_object_finds_its_model_or_one_that_extends_it(model: Model, cars: Model) -> None:
    models = open_models(model, cars)
    for instance in (model[1], cars.mean):
        assert models.adopt(instance) is instance
        assert models.adopt(MissingInstance(instance.fingerprint, instance.codes)) == instance
    assert models.of_category("cars") is cars and models.of_category("tables") is None
    assert list(models) == [model, cars]
    waiting = MissingInstance(model.fingerprint, model.codes[0])
    extended = replace(cars, extends=(model.fingerprint,))
    assert open_models(extended).adopt(waiting) == Instance(extended, waiting.codes)
    alone = open_models(cars)
    assert alone.adopt(waiting) is waiting and waiting.is_missing
    for read in (lambda: waiting.model, lambda: alone[model.fingerprint]):
        with pytest.raises(ValueError, match="a model that is not open"):
            read()


def test_a_model_is_loaded_once_under_any_of_its_names(model: Model) -> None:
    loaded = list[str]()

    def load(name: str) -> Model:
        loaded.append(name)
        return replace(model)

    models = OpenModels(load)
    assert models.open("chairs") is models.open("chairs") is models.open("/home/chairs.safetensors")
    assert loaded == ["chairs", "/home/chairs.safetensors"]
    assert len(list(models)) == 1


def test_objects_of_two_models_differ_and_are_not_mixed(model: Model, cars: Model) -> None:
    mine = model[0]
    same = Instance(cars, mine.codes)
    assert mine != same
    for mix in (lambda: mine.mixed(same, 0.5, 0.5), lambda: mine.taking("shape", same)):
        with pytest.raises(ValueError, match="different models"):
            mix()


def test_frames_of_two_models_follow_each_other(model: Model, cars: Model) -> None:
    def frames(*views: View) -> list[np.ndarray]:
        return [image for image in render_frames(views, None, exact=True) if image is not None]

    first, second = (View(opened[0], opened.camera(0.3, 0.2).resized(8, 8)) for opened in (model, cars))
    both = frames(first, second, first)
    for image, alone in zip(both, [*frames(first), *frames(second), *frames(first)], strict=True):
        np.testing.assert_array_equal(image, alone)
