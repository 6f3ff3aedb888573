from dataclasses import replace

import pytest
import torch

from core.detail.progressive import render_frame
from core.editing.words import Words, direction_words, most, moved, name_changes
from core.edits.warp import Warp
from core.models.library import load_model
from core.models.model import Instance, Model
from core.models.motion import LIMIT
from tests.conftest import random_model

_TABLE = {"height": ("taller", "lower", 0.1), "width": ("wider", "narrower", 0.1)}


def test_the_clearest_change_takes_its_word_first_and_no_word_is_used_twice() -> None:
    changes = [{"height": -0.3, "width": 0.2}, {"height": 0.4}, {"height": 0.02}, {}]
    assert name_changes(changes, _TABLE) == ("wider", "taller", "", "")


@pytest.mark.parametrize("name", ["chairs", "cars"])
def test_words_are_distinct_and_say_how_renders_change(name: str) -> None:
    model = replace(load_model(name), words=None)  # measured, not read from the file
    *_, words = direction_words(model)
    for kind in ("shape", "texture"):
        named = [word for word in words[kind] if word]
        assert len(words[kind]) == 6
        assert len(named) >= 3
        assert len(set(named)) == len(named)
    # Renders moved along *lighter*, or against *darker*, are lighter.
    signs = {"lighter": 1.0, "darker": -1.0}
    for word, step in zip(words["texture"], model.codes.texture_space.basis, strict=False):
        if word in signs:
            camera = model.camera(1.0, 0.4).resized(48, 48)
            dark, light = (model.mean.moved("texture", side * signs[word] * step) for side in (-1.5, 1.5))
            assert render_frame(light, camera).image.mean() > render_frame(dark, camera).image.mean()


def steps(instance: Instance) -> tuple[float, ...]:
    """How far edits moved an object along the first shape directions."""
    return instance.codes.of_kind(Warp)[0].steps


def test_codes_move_by_words_and_their_opposites(tiny: Model) -> None:
    instance = tiny[0]
    words = Words(shape=("", "rounder"), texture=("bluer",))
    more, less = (moved(instance, words, name, 0.5) for name in ("rounder", "more angular"))
    assert steps(more) == (0.0, 0.5) and steps(less) == (0.0, -0.5)
    assert torch.equal(more.codes.texture, instance.codes.texture)
    assert most(instance, words, "rounder") == pytest.approx(LIMIT)
    farthest = moved(instance, words, "rounder", 9.0)
    assert steps(farthest) == pytest.approx((0.0, LIMIT), abs=1e-3)
    assert most(instance, words, "bluer") == torch.inf
    assert not torch.equal(moved(instance, words, "more yellow", 1.0).codes.texture, instance.codes.texture)
    with pytest.raises(ValueError, match="no direction 'roof'; choose one of rounder, more angular, bluer"):
        moved(instance, words, "roof", 1.0)


@pytest.mark.parametrize("stored", [True, False])
def test_directions_of_sizes_have_no_word(stored: bool) -> None:
    """Sizes are set in centimetres."""
    model = load_model("cars") if stored else replace(load_model("cars"), words=None)
    *_, words = direction_words(model)
    assert words["shape"] == ("", "", "rounder", "heavier top", "", "longer top")
    with pytest.raises(ValueError, match="taller is a size"):
        moved(model[3], words, "taller", 1.0)
    assert not moved(model[3], words, "rounder", 2.0).is_sized


def test_models_without_sizes_have_words_for_them() -> None:
    words = Words(shape=("taller", "rounder"), texture=())
    *_, offered = direction_words(replace(random_model(white_from_network=True), words=words))
    assert offered == words
