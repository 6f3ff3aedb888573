import json

import pytest
import torch

from core.models.codes import Codes
from core.models.model import Model
from core.models.scene import Scene
from tests.conftest import random_model


def some(model: Model) -> Scene:
    codes = Codes(torch.randn(8) * 1e-3, torch.randn(4) * 1e3)
    return Scene(model.fingerprint, codes, model.camera(0.1 + 1e-15, 1 / 3))


def test_a_scene_comes_back_exactly(model: Model, tmp_path):
    scene = some(model)
    scene.save(tmp_path / "s.json")
    again = Scene.load(tmp_path / "s.json", model)
    assert again == scene
    assert torch.equal(again.codes.shape, scene.codes.shape)


def test_a_scene_that_cannot_be_written_is_named_and_leaves_nothing(model: Model, tmp_path):
    for path in (tmp_path / "gone" / "s.json", tmp_path):
        with pytest.raises(ValueError, match="cannot write"):
            some(model).save(path)
    assert list(tmp_path.iterdir()) == []


def test_a_scene_of_another_model_is_refused(model: Model, tmp_path):
    some(random_model(seed=1)).save(tmp_path / "s.json")
    with pytest.raises(ValueError, match="another model"):
        Scene.load(tmp_path / "s.json", model)


@pytest.mark.parametrize(
    "content", [b"", b"[]", b"hello", b"\xff\xfe\x00", b'{"model": 1}', b'{"camera": {}, "model": "x"}']
)
def test_what_is_no_scene_is_named(content: bytes, model: Model, tmp_path):
    path = tmp_path / "s.json"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"s\.json"):
        Scene.load(path, model)
    with pytest.raises(ValueError, match=r"gone\.json"):
        Scene.load(tmp_path / "gone.json", model)


def test_numbers_that_no_camera_has_are_refused(model: Model, tmp_path):
    about = json.loads(some(model).to_json())
    about["camera"]["distance"] = -1.0
    with pytest.raises(ValueError, match="distance"):
        Scene.from_json(json.dumps(about), model)
