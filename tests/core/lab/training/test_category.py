from pathlib import Path

import pytest
import torch

from core.classifiers.category import CategoryClassifier, predict_category
from core.classifiers.crops import SIDE
from core.lab.training import category
from core.lab.training.category import category_accuracy, random_distractors, train_category
from core.lab.training.viewpoint import ViewpointDataset


def bars(upright: bool, count: int = 32) -> ViewpointDataset:
    images = torch.full((count, 4, SIDE, SIDE), 255, dtype=torch.uint8)
    images[:, 3] = 0
    part = images[:, :, 4:44, 18:30] if upright else images[:, :, 18:30, 4:44]
    part[:] = torch.tensor([200, 40, 40, 255], dtype=torch.uint8)[:, None, None]
    return ViewpointDataset(images, torch.zeros(count), torch.zeros(count))


def test_distractors_are_images_that_show_something():
    images = bars(True).images.float() / 255
    found = random_distractors(images, 50, torch.Generator().manual_seed(0))
    assert found.shape == (50, 4, SIDE, SIDE)
    assert float(found[:, 3].mean((1, 2)).min()) > 0
    assert float(found.min()) >= -1e-4
    assert float(found.max()) <= 1 + 1e-4


def test_it_learns_to_tell_categories_apart_and_is_read_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(category, "BATCH_SIZE", 48)
    torch.manual_seed(0)
    classifier, datasets = CategoryClassifier(("posts", "planks")), (bars(True), bars(False))
    assert len(list(train_category(classifier, datasets, 60))) == 60
    assert category_accuracy(classifier, datasets[0].images, 0) > 0.9
    assert category_accuracy(classifier, datasets[1].images, 1) > 0.9
    classifier.save(tmp_path / "categories.safetensors")
    read = CategoryClassifier.load(tmp_path / "categories.safetensors")
    crop = datasets[0].images[0].float() / 255
    guess = predict_category(read, crop[:3].movedim(0, -1), crop[3] > 0.5)
    assert set(guess) == {"posts", "planks"}
    assert guess["posts"] > 0.5 > guess["planks"]


def test_another_file_is_not_a_classifier(tmp_path: Path):
    (tmp_path / "c.safetensors").write_bytes(b"nothing of the kind")
    with pytest.raises(ValueError, match=r"c\.safetensors: not a category classifier"):
        CategoryClassifier.load(tmp_path / "c.safetensors")
