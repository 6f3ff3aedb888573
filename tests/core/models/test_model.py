import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from core.classifiers.viewpoint import SIDE, ViewpointClassifier
from core.models.codes import CodeBook
from core.models.model import Instance, Model
from core.models.part_head import PartHead
from core.runtime.reading import read_tensors
from tests.conftest import with_contrast


def reloaded(model: Model, folder: Path) -> Model:
    """The model that the file of a model holds."""
    model.save(folder / "m.safetensors")
    return Model.load(folder / "m.safetensors")


def test_saving_and_loading_is_exact(model: Model, tmp_path):
    model = replace(model, codes=replace(model.codes, collapsed=frozenset({1, 4})))
    again = reloaded(model, tmp_path)
    assert again.fingerprint == model.fingerprint
    for name in ("extent", "category", "focal", "distance", "white_from_network"):
        assert getattr(again, name) == getattr(model, name)
    assert (again.codes[3], again.codes.objects) == (model.codes[3], model.codes.objects)
    assert again.codes.collapsed == {1, 4}
    assert [entry.name for entry in tmp_path.iterdir()] == ["m.safetensors"]


def test_a_viewpoint_classifier_is_saved_in_half_precision_and_changes_no_scene(model: Model, tmp_path):
    looking = replace(model, viewpoint_classifier=ViewpointClassifier())
    again = reloaded(looking, tmp_path)
    assert again.fingerprint == model.fingerprint
    assert looking.viewpoint_classifier is not None
    assert again.viewpoint_classifier is not None
    crops = torch.rand(2, 4, SIDE, SIDE)
    assert torch.allclose(again.viewpoint_classifier(crops), looking.viewpoint_classifier(crops), atol=1e-2)
    assert model.viewpoint_classifier is None


def test_a_part_head_is_saved_and_changes_no_scene(model: Model, tmp_path):
    width = model.field.config.width
    head = PartHead(("seat", "legs"), torch.randn(2, width), torch.randn(2))
    again = reloaded(replace(model, part_head=head), tmp_path)
    assert again.fingerprint == model.fingerprint
    assert again.part_head.names == head.names
    features = torch.randn(5, width)
    assert torch.equal(again.part_head(features), head(features))
    torch.testing.assert_close(head(features).sum(1), torch.ones(5))
    with pytest.raises(ValueError, match="part head does not fit"):
        replace(model, part_head=PartHead(head.names, torch.zeros(2, width + 1), head.bias))
    for names in ((), ("seat",), ("seat", "seat"), ("seat", ""), ("seat", "back", "legs")):
        with pytest.raises(ValueError, match="parts"):
            replace(head, names=names)
    with pytest.raises(ValueError, match="part head must be finite"):
        replace(head, bias=head.bias * math.inf)


def test_codes_are_saved_in_half_precision_if_lossless_and_identify_the_model(model: Model, tmp_path):
    shapes = model.codes.shapes.half().float()
    rounded = replace(model, codes=replace(model.codes, shapes=shapes, textures=shapes[:, :4] + 1e-5))
    assert reloaded(rounded, tmp_path).fingerprint == rounded.fingerprint
    with safe_open(tmp_path / "m.safetensors", framework="pt") as file:
        assert file.get_tensor("codes.shapes").dtype == torch.half
        assert file.get_tensor("codes.textures").dtype == torch.float
    moved = CodeBook(model.codes.shapes + 1e-3, model.codes.textures, model.codes.objects)
    changed = Model(model.field, moved, model.extent, model.category, model.image_size, model.focal, model.distance)
    assert changed.fingerprint != model.fingerprint


def test_codes_are_shared_with_former_models_and_cameras_as_in_training(model: Model, tmp_path):
    again = reloaded(replace(model, extends=("former", "first")), tmp_path)
    assert again.fingerprint == model.fingerprint
    assert all(map(again.shares_codes_with, (model.fingerprint, "former", "first")))
    assert not again.shares_codes_with("other")
    assert not model.shares_codes_with("former")
    camera = model.camera(0.1, 0.2)
    assert (camera.distance, camera.focal, camera.width) == (2.0, 32.8, 32)


def test_files_that_hold_no_model_are_named(tmp_path):
    missing, text, foreign, partial = (tmp_path / f"{name}.safetensors" for name in ("no", "text", "foreign", "part"))
    text.write_text("hello")
    save_file({"a": torch.zeros(1)}, foreign)
    save_file({"a": torch.zeros(1)}, partial, metadata={"model": json.dumps({"config": {}})})
    for path in (missing, text, foreign, partial, tmp_path):
        with pytest.raises(ValueError, match=path.name):
            Model.load(path)


@pytest.mark.parametrize(
    "wrong",
    [
        {"image_size": 0},
        {"image_size": 40_000},
        {"focal": math.nan},
        {"focal": -1.0},
        {"distance": math.inf},
        {"extent": (0.0, 0.3, 0.4)},
    ],
)
def test_numbers_that_no_model_has_are_refused(model: Model, wrong: dict):
    with pytest.raises(ValueError, match="x of a model" if "extent" in wrong else next(iter(wrong))):
        replace(model, **wrong)


def test_models_that_could_only_show_nothing_are_refused(model: Model):
    with pytest.raises(ValueError, match="all objects of the model collapsed"):
        replace(model, codes=replace(model.codes, collapsed=frozenset(range(6))))
    with pytest.raises(ValueError, match="codes must be finite"):
        replace(model.codes, shapes=torch.full((6, 8), math.inf))
    with pytest.raises(ValueError, match="do not fit the field"):
        replace(model, codes=replace(model.codes, textures=torch.zeros(6, 5)))
    with torch.no_grad():
        model.field.density_layer.bias.fill_(math.nan)
    with pytest.raises(ValueError, match=r"density_layer\.bias of a model must be finite"):
        replace(model)


@pytest.mark.parametrize(
    ("key", "value", "reason"),
    [
        ("", [], "model must be an object"),
        ("config", {"shape_blocks": 10_000_000}, "shape_blocks of a field is 1 to 32"),
        ("image_size", 32.5, r"model\.image_size must be a whole number"),
        ("extent", [1, 2], r"model\.extent has 3 parts"),
        ("objects", [["a", 0]], r"model\.objects\[0\] has 3 parts"),
        ("category", None, r"model\.category must be a text"),
    ],
)
def test_metadata_of_another_kind_is_named(model: Model, tmp_path: Path, key: str, value: object, reason: str):
    path = tmp_path / "m.safetensors"
    model.save(path)
    metadata, tensors = read_tensors(path)
    stored = json.loads(metadata["model"]) | {key: value} if key else value
    save_file(tensors, path, metadata={"model": json.dumps(stored)})
    with pytest.raises(ValueError, match=rf"m\.safetensors: {reason}"):
        Model.load(path)


def test_a_soft_model_has_no_contrast_and_shares_weights_and_scenes(model: Model, tmp_path):
    sharp = with_contrast(model)
    again = reloaded(sharp, tmp_path)
    assert again.field.config.contrast == 20.0
    assert again.soft.field.config.contrast == 0.0
    assert again.soft.soft is again.soft
    assert again.soft.field.point_layer is again.field.point_layer
    assert again.soft.fingerprint == again.fingerprint == model.fingerprint
    assert model.soft is model


def test_objects_are_equal_if_their_models_render_alike_and_their_codes_are_equal(model: Model) -> None:
    first = model[0]
    second = model[1]
    assert first == Instance(replace(model), model.codes[0]) and hash(first) == hash(model[0])
    assert first != second and first != Instance(replace(model, white_from_network=True), model.codes[0])
    assert first.mixed(second, 0.0, 1.0) == first.with_texture(second) == second.with_shape(first)
    assert first.mixed(second, 1.0, 1.0) == second
    assert torch.equal(first.moved("texture", torch.ones(4)).codes.texture, first.codes.texture + 1)
    assert model.first == first and model.mean.codes == model.codes.mean
    with pytest.raises(ValueError, match="no photos"):
        _ = first.fitted
