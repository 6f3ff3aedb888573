import math
from dataclasses import replace
from itertools import zip_longest

import pytest

from core.models.codes import CodeBook
from core.models.model import Model
from core.photos.view_bank import apparent_size, build_view_bank, surface_points, view_bank
from core.rendering.reference import render_exact
from tests.conftest import random_model
from tests.core.tiny import EXTENT


def test_the_surface_lies_in_the_box_and_has_the_colours_of_the_object(tiny: Model):
    points, colours = surface_points(tiny, tiny.codes[3])
    assert len(points) > 500
    assert bool((points.abs() < EXTENT[0]).all())
    assert 0 <= float(colours.min()) <= float(colours.max()) <= 1


def test_apparent_sizes_in_training_images(tiny: Model):
    usual = apparent_size(tiny)
    seen = render_exact(tiny, tiny.codes[0], tiny.camera(0.7, 0.4), 32).opacity > 0.5
    size = max(int(seen.any(0).sum()), int(seen.any(1).sum())) / tiny.image_size
    assert usual.min < size < usual.max


def test_a_bank_is_made_once_per_model(tiny: Model):
    assert view_bank(tiny) is view_bank(tiny)


def test_two_who_build_in_turn_share_the_work(tiny: Model):
    def other(scale: float) -> Model:
        """One of another fingerprint, whose view bank nobody has built yet."""
        book = tiny.codes
        return replace(tiny, codes=CodeBook(scale * book.shapes, book.textures, book.objects))

    alone = len(list(build_view_bank(other(1.01))))
    shared = other(1.02)
    turns = list(zip_longest(build_view_bank(shared), build_view_bank(shared)))
    assert len(turns) == math.ceil(alone / 2)


def test_a_model_that_shows_nothing_is_refused():
    empty = random_model()
    empty.field.density_layer.bias.fill_(-1e4)
    with pytest.raises(ValueError, match="no objects"):
        view_bank(empty)
