from dataclasses import replace

import pytest
import torch

from core.editing.size import size_of
from core.editing.words import AXES, Words, direction_words, most, moved, name_changes
from core.edits.warp import Warp
from core.models.library import load_model
from core.models.model import Instance, Model
from core.models.motion import LIMIT

_TABLE = {"height": ("taller", "lower", 0.1), "width": ("wider", "narrower", 0.1)}


def test_the_clearest_change_takes_its_word_first_and_no_word_is_used_twice() -> None:
    changes = [{"height": -0.3, "width": 0.2}, {"height": 0.4}, {"height": 0.02}, {}]
    assert name_changes(changes, _TABLE) == ("wider", "taller", "", "")


@pytest.mark.parametrize("name", ["chairs", "cars"])
def test_words_are_distinct_and_say_how_renders_change(name: str) -> None:
    *_, words = direction_words(replace(load_model(name), words=None))  # measured, not read from the file
    for kind in ("shape", "texture"):
        named = [word for word in words[kind] if word]
        assert len(words[kind]) == 6
        assert len(named) >= 4
        assert len(set(named)) == len(named)
    assert lightness_rises(name, words) in (None, True)


def lightness_rises(name: str, words: Words) -> bool | None:
    """Return True if renders moved along *lighter* (or against *darker*) are lighter; None without these words."""
    from core.detail.progressive import render_frame

    model = load_model(name)
    signs = {"lighter": 1.0, "darker": -1.0}
    direction = next((index for index, word in enumerate(words["texture"]) if word in signs), None)
    if direction is None:
        return None
    step = signs[words["texture"][direction]] * model.codes.texture_space.basis[direction]
    camera = model.camera(1.0, 0.4).resized(48, 48)
    dark, light = (
        float(render_frame(model.mean.moved("texture", side * step), camera).image.mean()) for side in (-1.5, 1.5)
    )
    return light > dark


def steps(instance: Instance) -> tuple[float, ...]:
    """How far edits moved an object along the first shape directions."""
    return instance.codes.of_kind(Warp)[0].steps


def test_codes_move_by_words_and_their_opposites(tiny: Model) -> None:
    instance = tiny[0]
    words = Words(shape=("", "taller"), texture=("bluer",))
    higher, lower = (moved(instance, words, name, 0.5) for name in ("taller", "lower"))
    assert steps(higher) == (0.0, 0.5) and steps(lower) == (0.0, -0.5)
    assert torch.equal(higher.codes.texture, instance.codes.texture)
    assert most(instance, words, "taller") == pytest.approx(LIMIT)
    farthest = moved(instance, words, "taller", 9.0)
    assert steps(farthest) == pytest.approx((0.0, LIMIT), abs=1e-3)
    assert most(instance, words, "bluer") == torch.inf
    assert not torch.equal(moved(instance, words, "more yellow", 1.0).codes.texture, instance.codes.texture)
    with pytest.raises(ValueError, match="no direction 'roof'; choose one of taller, lower, bluer, more yellow"):
        moved(instance, words, "roof", 1.0)


@pytest.mark.parametrize("stored", [True, False])
def test_words_of_sizes_change_that_side_alone(stored: bool) -> None:
    words = load_model("cars").words
    assert words is not None
    model = load_model("cars") if stored else replace(load_model("cars"), words=None)
    car = model[3]
    before = size_of(car)
    for word in ("taller", "lower", "longer", "narrower"):
        axis, sign = AXES[word]
        edited = moved(car, words, word, 2.0)
        ratios = [now / then for now, then in zip(size_of(edited), before, strict=True)]
        assert sign * (ratios.pop(axis) - 1) > 0.08
        assert ratios == pytest.approx([1.0, 1.0], abs=0.05)
        assert moved(edited, words, word, -2.0) == car
    assert not moved(car, words, "rounder", 2.0).is_sized
