from pathlib import Path

import pytest
import torch

from core.lab.datasets.srn import Dataset
from core.lab.training.gallery import select_gallery, training_psnr
from core.lab.training.trainer import Trainer
from core.models.codes import CodeBook, Entry
from core.models.model import Model
from tests.core.lab.training.test_trainer import SETTINGS, dataset

__all__ = ["dataset"]


def book_of(places: list[float]) -> CodeBook:
    """Objects along a line of shapes, all of one texture."""
    shapes = torch.tensor(places)[:, None] * torch.tensor([[1.0, 0.5]])
    entries = tuple(Entry(f"object {i}", i, 0) for i in range(len(places)))
    return CodeBook(shapes, torch.tensor([[1.0], [2.0]]), entries)


def test_a_gallery_begins_in_the_middle_and_holds_no_near_doubles():
    book = book_of([0.0, 0.01, 0.02, 5.0, 5.01, -5.0, -5.01, 0.03])
    chosen = select_gallery(book, {entry.name: 30.0 - index / 100 for index, entry in enumerate(book.objects)}, 3)
    assert {round(float(book[index].shape[0]) / 5) for index in chosen} == {-1, 0, 1}
    assert abs(float(book[chosen[0]].shape[0])) < 0.1


def test_the_worst_quarter_and_objects_without_a_score_stay_out():
    book = book_of([0.0, 1.0, 2.0, 3.0, 4.0])
    scores = {"object 0": 30.0, "object 1": 12.0, "object 2": 31.0, "object 3": 29.0}
    assert sorted(select_gallery(book, scores, 10)) == [0, 2, 3]
    with pytest.raises(ValueError, match="none of the model's objects"):
        select_gallery(book, {"another": 30.0})


def test_a_model_with_a_gallery_keeps_spaces_and_renders_the_same(dataset: Dataset, tmp_path: Path):
    model = Trainer(dataset, SETTINGS).model()
    scores = training_psnr(model, dataset)
    assert set(scores) == {"red", "blue"}
    small = model.subset([1])
    small.save(tmp_path / "small.safetensors")
    read = Model.load(tmp_path / "small.safetensors")
    assert [entry.name for entry in read.codes.objects] == ["blue"]
    assert read.codes[0] == model.codes[1]
    assert read.fingerprint == model.fingerprint
    for kept, all_of_them in ((read.codes.shape_space, model.codes.shape_space),):
        torch.testing.assert_close(kept.mean, all_of_them.mean)
        torch.testing.assert_close(kept.basis, all_of_them.basis)
    assert read.codes.mean == model.codes.mean
