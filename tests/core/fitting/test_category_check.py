import pytest
import torch

from core.fitting.category_check import category_likelihood, describe_category, likeliest_category
from core.models.library import sample_images, shipped_models
from core.photos.decode import read_rgba
from core.photos.photo import Photo
from core.photos.segmentation import cut_out


def photo_of(categories: dict[str, float]) -> Photo:
    return Photo(torch.ones(8, 8, 3), torch.ones(8, 8, dtype=torch.bool), categories=categories)


@pytest.mark.parametrize("category", shipped_models())
def test_samples_are_recognised(category: str):
    for path in sample_images(category):
        guess = cut_out(read_rgba(path)).categories
        assert likeliest_category(guess) == category
        assert category_likelihood(category, (photo_of(guess),)) == pytest.approx(guess[category])
        assert describe_category(guess, category) == ""


def test_other_categories_and_unknown_objects_are_described():
    guess = cut_out(read_rgba(sample_images("cars")[0])).categories
    assert category_likelihood("chairs", (photo_of(guess), photo_of(guess))) < 0.1
    assert describe_category(guess, "chairs") == "this looks like a car, not a chair: try the cars model"
    guess = {"cars": 0.2, "chairs": 0.2}
    assert likeliest_category(guess) is None
    assert describe_category(guess, "cars") == "this does not look like a car"
    assert describe_category({"cars": 0.2}, "stools") == ""
    assert likeliest_category({}) is None
    assert category_likelihood("stools", (photo_of({}),)) == 1


@pytest.mark.parametrize(
    ("share", "least", "most"), [(0.8, 0.99, 1.0), (0.5, 0.5, 0.5), (0.2, 0.0, 0.01), (0.0, 0.0, 0.0)]
)
def test_photos_of_one_object_are_evidence_each(share: float, least: float, most: float) -> None:
    assert least <= category_likelihood("cars", [photo_of({"cars": share})] * 8) <= most
