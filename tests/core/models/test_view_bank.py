from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from core.classifiers.viewpoint import directions
from core.models.model import Model
from core.models.view_bank import SIDE, ViewBank
from core.runtime.reading import read_tensors
from tests.core.models.test_model import reloaded


def random_bank(prototypes: int = 3) -> ViewBank:
    count = prototypes, len(directions()[0])
    silhouettes = torch.randint(256, (*count, SIDE * SIDE // 8), dtype=torch.uint8)
    sizes, offsets = (torch.rand(*count, *more).half().float() for more in ((), (2,)))
    return ViewBank(torch.arange(prototypes) - 1, 2.0, silhouettes, sizes, offsets)


@pytest.fixture
def complete(model: Model) -> Model:
    return replace(model, view_bank=random_bank(), words={"shape": ("wider", ""), "texture": ("redder",)})


@pytest.mark.parametrize("prototypes", [0, 3])
def test_bank_and_words_are_saved_exactly_and_change_no_scene(complete: Model, prototypes: int, tmp_path: Path):
    complete = replace(complete, view_bank=random_bank(prototypes))
    model = reloaded(complete, tmp_path)
    assert model.fingerprint == complete.fingerprint
    assert model.words == complete.words
    assert model.view_bank.distance == model.distance
    for name in ("prototypes", "silhouettes", "sizes", "offsets"):
        assert torch.equal(getattr(model.view_bank, name), getattr(complete.view_bank, name)), name


def test_shapes_are_rows_of_the_code_book_and_their_mean(complete: Model):
    shapes = complete.view_bank.shapes(complete.codes)
    assert torch.equal(shapes, torch.stack((complete.codes.mean.shape, *complete.codes.shapes[:2])))


def test_a_file_without_bank_and_words_opens(model: Model, tmp_path: Path):
    again = reloaded(model, tmp_path)
    assert again.view_bank is None and again.words is None


@pytest.mark.parametrize(
    ("name", "tensor", "reason"),
    [
        ("silhouettes", torch.ones(40, dtype=torch.uint8), "silhouettes of the view bank are damaged"),
        ("silhouettes", random_bank(2).to_tensors()["silhouettes"], "do not fit 3 prototypes"),
        ("silhouettes", random_bank(4).to_tensors()["silhouettes"], "do not fit 3 prototypes"),
        ("silhouettes", random_bank(3).to_tensors()["silhouettes"][:900], "do not fit 3 prototypes"),
        ("sizes", torch.zeros(3, 5), "do not fit 3 prototypes"),
        ("offsets", torch.full((3, len(directions()[0]), 2), torch.nan), "must be finite"),
        ("prototypes", torch.tensor([0, 1, 6]), "does not fit the codes"),
        ("prototypes", torch.tensor([0, 1, -2]), "does not fit the codes"),
        ("prototypes", torch.zeros(20_000), "at most 10000 prototypes"),
    ],
)
@pytest.mark.usefixtures("unchecked")
def test_a_damaged_bank_is_named(complete: Model, name: str, tensor: torch.Tensor, reason: str, tmp_path: Path):
    path = tmp_path / "m.safetensors"
    complete.save(path)
    metadata, tensors = read_tensors(path)
    save_file(tensors | {f"view_bank.{name}": tensor}, path, metadata=metadata)
    with pytest.raises(ValueError, match=rf"m\.safetensors: .*{reason}"):
        Model.load(path)
