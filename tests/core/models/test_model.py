import json
from dataclasses import replace

import pytest
import torch
from safetensors.torch import save_file

from core.models.codes import CodeBook
from core.models.model import Model
from core.models.viewpoint import SIDE, ViewpointClassifier


def test_saving_and_loading_is_exact(model: Model, tmp_path):
    path = tmp_path / "m.safetensors"
    model.save(path)
    again = Model.load(path)
    assert again.fingerprint == model.fingerprint
    assert again.codes[3] == model.codes[3]
    assert (again.extent, again.category, again.focal, again.distance, again.painted_ground) == (
        model.extent,
        model.category,
        model.focal,
        model.distance,
        model.painted_ground,
    )
    assert again.codes.objects == model.codes.objects
    assert [entry.name for entry in tmp_path.iterdir()] == ["m.safetensors"]


def test_a_glance_is_saved_in_half_precision_and_changes_no_scene(model: Model, tmp_path):
    looking = replace(model, glance=ViewpointClassifier())
    looking.save(tmp_path / "m.safetensors")
    again = Model.load(tmp_path / "m.safetensors")
    assert again.fingerprint == model.fingerprint
    assert looking.glance is not None
    assert again.glance is not None
    seen = torch.rand(2, 4, SIDE, SIDE)
    assert torch.allclose(again.glance(seen), looking.glance(seen), atol=1e-2)
    assert model.glance is None


def test_broken_objects_are_remembered(model: Model, tmp_path):
    book = replace(model.codes, broken=frozenset({1, 4}))
    replace(model, codes=book).save(tmp_path / "m.safetensors")
    assert Model.load(tmp_path / "m.safetensors").codes.broken == {1, 4}


def test_another_code_is_another_model(model: Model):
    moved = CodeBook(model.codes.shapes + 1e-3, model.codes.textures, model.codes.objects)
    other = Model(model.field, moved, model.extent, model.category, model.image_size, model.focal, model.distance)
    assert other.fingerprint != model.fingerprint


def test_what_is_no_model_file_is_named(tmp_path):
    missing, text, foreign, partial = (tmp_path / f"{name}.safetensors" for name in ("no", "text", "foreign", "part"))
    text.write_text("hello")
    save_file({"a": torch.zeros(1)}, foreign)
    save_file({"a": torch.zeros(1)}, partial, metadata={"model": json.dumps({"config": {}})})
    for path in (missing, text, foreign, partial, tmp_path):
        with pytest.raises(ValueError, match=path.name):
            Model.load(path)


def test_cameras_look_as_the_training_pictures_did(model: Model):
    camera = model.camera(0.1, 0.2)
    assert (camera.distance, camera.focal, camera.width) == (2.0, 32.8, 32)
