"""Offsets are part of an object: mixed, taken and stored with the codes."""

import pickle

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from core.models.latents import Latents, mixed_offsets, read_offsets
from core.models.model import Instance, Model
from core.models.scene import Scene
from core.rendering.images import render_image

BLOCKS, WIDTH = 2, 32  # of the tiny model


def offsets(seed: int, blocks: int = BLOCKS, scale: float = 1.0) -> torch.Tensor:
    return (scale * torch.randn(blocks, WIDTH, generator=torch.Generator().manual_seed(seed))).half()


def freed(model: Model, index: int, scale: float = 1.0) -> Instance:
    return model[index].changed(shape_offsets=offsets(index, 2, scale), texture_offsets=offsets(9, 1, scale))


def test_offsets_are_counted_in_standard_deviations_of_the_training_biases(tiny: Model):
    instance = freed(tiny, 0)
    plain = tiny[0]
    for bias, base, std, offset in zip(
        instance.biases,
        plain.biases,
        tiny.bias_std,
        (instance.codes.shape_offsets, instance.codes.texture_offsets),
        strict=True,
    ):
        torch.testing.assert_close(bias, base + offset.float() * std)
    training_biases = tiny.field.shape_bias(tiny.codes.shapes)
    torch.testing.assert_close(tiny.bias_std[0], training_biases.std(0, unbiased=False).clamp_min(1e-3))
    assert torch.equal(tiny.bias_std[0], tiny.soft.bias_std[0])


def test_zero_offsets_change_no_render(tiny: Model):
    camera = tiny.camera(0.4, 0.5)
    zeros = freed(tiny, 0, scale=0.0)
    assert torch.equal(render_image(zeros, camera).colour, render_image(tiny[0], camera).colour)


@given(st.floats(0, 1), st.integers(0, 100))
def test_offsets_are_mixed_as_codes_are(amount: float, seed: int):
    first = offsets(seed)
    second = offsets(seed + 1)
    expected = torch.lerp(first.float(), second.float(), amount)
    torch.testing.assert_close(mixed_offsets(first, second, amount).float(), expected, atol=2e-3, rtol=2e-3)
    torch.testing.assert_close(
        mixed_offsets(first, None, amount).float(), first.float() * (1 - amount), atol=2e-3, rtol=0
    )
    assert torch.equal(mixed_offsets(first, second, 0.0), first)
    assert torch.equal(mixed_offsets(None, second, 1.0), second)
    assert mixed_offsets(None, None, amount) is None


def test_shape_and_texture_take_their_own_offsets(tiny: Model):
    instance = freed(tiny, 0)
    plain = tiny[1]
    mixed = instance.mixed(plain, shape=1.0, texture=0.0)
    assert not mixed.codes.shape_offsets.any() and torch.equal(
        mixed.codes.texture_offsets, instance.codes.texture_offsets
    )
    assert torch.equal(plain.taking("texture", instance).codes.texture_offsets, instance.codes.texture_offsets)
    assert plain.taking("texture", instance).codes.shape_offsets is None
    assert instance.taking("shape", plain).codes.shape_offsets is None
    assert torch.equal(instance.taking("shape", plain).codes.texture_offsets, instance.codes.texture_offsets)


def test_objects_with_other_offsets_are_other_objects(tiny: Model):
    instance = freed(tiny, 0)
    same = instance.changed(shape_offsets=instance.codes.shape_offsets.clone())
    assert instance == same and hash(instance) == hash(same)
    for unequal in (tiny[0], instance.changed(shape_offsets=offsets(7)), instance.changed(texture_offsets=None)):
        assert instance != unequal
    assert instance.codes.texture_key == instance.changed(shape_offsets=None).codes.texture_key
    zeros = torch.zeros(BLOCKS, WIDTH).half()
    assert tiny[0].changed(shape_offsets=zeros) == tiny[0].changed(shape_offsets=-zeros)
    with pytest.raises(ValueError, match="finite"):
        Latents(torch.zeros(2), torch.zeros(2), torch.full((2, 3), torch.inf).half())


def test_a_key_is_short_and_no_part_of_a_pickled_object(tiny: Model):
    codes = tiny[0].changed(shape_offsets=offsets(0, 1000)).codes
    assert len(pickle.dumps(codes.shape_key)) < 200
    assert "_keys" in vars(codes) and "_keys" not in codes.__getstate__()
    assert pickle.loads(pickle.dumps(codes)) == codes


def test_plain_scenes_have_no_offsets_and_damaged_ones_are_refused(tiny: Model):
    assert "offsets" not in Scene(tiny[0], tiny.camera(0.4, 0.5)).to_json()
    for texts in (("?",), ("AAA=",) * 2 + ("AAAAAA==",), ("AAAA",), ()):
        with pytest.raises(ValueError):
            read_offsets(texts)
