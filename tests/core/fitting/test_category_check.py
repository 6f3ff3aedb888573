import pytest
import torch

from core.fitting.category_check import category_likelihood, describe_category, guess_category, likeliest_category
from core.fitting.fit import FitJob, FitSettings, fit
from core.models.library import category_classifier, sample_images, shipped_models
from core.photos.decode import read_rgba
from core.photos.photo import Photo
from core.photos.segmentation import cut_out
from tests.conftest import make_view_bank
from tests.core.tiny import photo_of, tiny_model


def sample(category: str, index: int = 0) -> Photo:
    cut = cut_out(read_rgba(sample_images(category)[index]))
    return Photo(torch.from_numpy(cut.pixels), torch.from_numpy(cut.mask))


def test_the_classifier_knows_the_shipped_categories():
    classifier = category_classifier()
    assert classifier is not None
    assert set(classifier.categories) == set(shipped_models())


@pytest.mark.parametrize("category", shipped_models())
def test_samples_are_recognised(category: str):
    for index in range(len(sample_images(category))):
        photo = sample(category, index)
        guess = guess_category(photo.pixels, photo.mask)
        assert likeliest_category(guess) == category
        assert category_likelihood(category, (photo,)) == guess[category]
        assert describe_category(guess, category) == ""


def test_a_car_is_no_chair():
    photo = sample("cars")
    guess = guess_category(photo.pixels, photo.mask)
    assert category_likelihood("chairs", (photo, photo)) < 0.1
    assert describe_category(guess, "chairs") == "this looks like a car, not a chair: try the cars model"


def test_noise_is_nothing_that_is_known():
    pixels = torch.rand(64, 64, 3, generator=torch.Generator().manual_seed(0))
    guess = guess_category(pixels, torch.ones(64, 64, dtype=torch.bool))
    assert likeliest_category(guess) is None
    assert describe_category(guess, "cars") == "this does not look like a car"


def test_what_the_classifier_does_not_know_is_not_doubted():
    model = tiny_model()
    photo = photo_of(model, model.codes[0], model.camera(0.7, 0.4))
    assert category_likelihood("stools", (photo,)) == 1
    assert describe_category({"cars": 0.2}, "stools") == ""
    assert likeliest_category({}) is None
    make_view_bank(model)
    *_, last = fit(model, FitJob((photo,), FitSettings(hypotheses=4, steps=8, rays=32, samples=16)))
    assert last.category_likelihood == 1
