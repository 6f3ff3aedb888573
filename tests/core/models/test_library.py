from dataclasses import replace

import pytest

from core.models import library
from core.models.library import load_model, sample_images, shipped_models
from core.models.model import Model
from tests.core.tiny import tiny_model


def test_models_load_by_path_or_shipped_name_with_classifier_and_cells(model: Model, tmp_path):
    model.save(tmp_path / "mine.safetensors")
    assert load_model(str(tmp_path / "mine.safetensors")).fingerprint == model.fingerprint
    for name in shipped_models():
        shipped = load_model(name)
        assert shipped.category == name
        assert shipped.viewpoint_classifier is not None
        assert shipped.stored_cells is not None


def test_unknown_names_and_missing_devices_are_refused(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(ValueError, match=r"no model called 'boats' \(shipped: "):
        load_model("boats")
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    with pytest.raises(ValueError, match="no CUDA device"):
        load_model("chairs", "cuda")


@pytest.mark.parametrize("name", ["gone.safetensors", "gone.pth"])
def test_a_missing_file_is_named(name: str, tmp_path):
    with pytest.raises(ValueError, match=name):
        load_model(str(tmp_path / name))


def test_a_model_in_the_folder_of_shipped_ones_is_a_category_with_its_own_sizes(tmp_path, monkeypatch):
    replace(tiny_model(), category="boats", metres=6.0).save(tmp_path / "boats.safetensors")
    monkeypatch.setattr(library, "SHIPPED", tmp_path)
    assert shipped_models() == ("boats",)
    boats = load_model("boats")
    assert (boats.noun, boats.metres) == ("boat", 6.0)


def test_shipped_models_have_samples():
    assert sample_images("boats") == ()
    for category in shipped_models():
        assert len(sample_images(category)) >= 3
