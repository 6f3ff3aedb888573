"""The free stage explains objects that no code reaches, and keeps the camera's confidence."""

from dataclasses import replace

import pytest
import torch

from core.fitting.fit import FitJob, fit
from core.metrics import psnr
from core.models.library import load_model
from core.models.model import Instance, Model
from core.rendering.images import render_image
from tests.core.fitting.inputs import QUICK, SHORT
from tests.core.models.test_latents import freed
from tests.core.tiny import photo_of

FREE = replace(SHORT, steps=20, rays=192, samples=24, free_steps=12)


def unreachable(model: Model) -> Instance:
    """An object off the surface that codes reach."""
    return freed(model, 0, scale=0.6)


def test_offsets_explain_an_object_that_no_code_reaches(tiny: Model):
    camera = tiny.camera(0.5, 0.4)
    photo = replace(photo_of(unreachable(tiny), camera), camera=camera)
    *_, searched = fit(tiny, FitJob((photo,), replace(FREE, free_steps=0)))
    *_, free = fit(tiny, FitJob((photo,), FREE))
    assert searched.instance.codes.shape_offsets is None
    assert free.instance.codes.shape_offsets is not None and free.instance.codes.texture_offsets is not None
    plain, better = (
        psnr(render_image(step.instance.with_detail(None), camera).colour, photo.pixels) for step in (searched, free)
    )
    assert better > plain + 1.0


def test_the_free_stage_ends_a_search_and_keeps_its_confidence(tiny: Model):
    photo = photo_of(unreachable(tiny), tiny.camera(0.5, 0.4))
    steps = list(fit(tiny, FitJob((photo,), FREE)))
    searched = [step for step in steps if not step.is_free]
    assert [step.is_free for step in steps] == [False] * len(searched) + [True] * FREE.free_steps
    assert steps[-1].step == steps[-1].steps
    before = searched[-1]
    after = steps[-1]
    assert before.instance.detail is None and after.instance.detail is not None
    assert (after.confidence, after.margin, after.uncertainty) == (before.confidence, before.margin, before.uncertainty)
    assert after.runner_up is not None and before.runner_up is not None
    assert after.runner_up.cameras == before.runner_up.cameras
    losses = [step.loss for step in steps if step.is_free]
    assert losses == sorted(losses, reverse=True)
    assert after.instance.detail.fitted.shape_key == after.instance.codes.shape_key


def test_no_offsets_without_free_steps_or_with_a_painted_background(tiny: Model):
    photo = photo_of(tiny[0], tiny.camera(0.5, 0.4))
    job = FitJob((photo,), FREE)
    white = replace(tiny, white_from_network=True)
    for model, settings in ((tiny, replace(FREE, free_steps=0)), (white, FREE)):
        *_, last = fit(model, replace(job, settings=settings))
        assert last.instance.codes.shape_offsets is None and not last.is_free


def test_offsets_of_a_training_object_are_small(tiny: Model):
    camera = tiny.camera(0.5, 0.4)
    photo = replace(photo_of(tiny[0], camera), camera=camera)
    *_, last = fit(tiny, FitJob((photo,), QUICK))
    assert last.instance.codes.shape_offsets is not None
    assert float(last.instance.codes.shape_offsets.float().square().mean().sqrt()) < 0.3
    behind = tiny.camera(2.6, 0.4)
    rendered, truth = (render_image(instance, behind).colour for instance in (last.instance.with_detail(None), tiny[0]))
    assert psnr(rendered, truth) > 25


@pytest.mark.parametrize("posed", [True, False])
def test_the_same_seed_gives_the_same_offsets(tiny: Model, posed: bool):
    camera = tiny.camera(0.5, 0.4)
    photo = replace(photo_of(unreachable(tiny), camera), camera=camera if posed else None)
    (*_, first), (*_, second) = (fit(tiny, FitJob((photo,), FREE)) for _ in range(2))
    assert torch.equal(first.instance.codes.shape_offsets, second.instance.codes.shape_offsets)


def test_a_doubtful_mask_adds_to_the_object_and_carves_nothing(tiny: Model):
    camera = tiny.camera(0.5, 0.4)
    photo = replace(photo_of(tiny[0], camera), camera=camera)
    rows, columns = photo.mask.nonzero().float().mean(0).long().tolist()
    mask = photo.mask.clone()
    pixels = photo.pixels.clone()
    mask[rows - 3 : rows + 4, columns:] = False  # a gap open to the right
    pixels[~mask] = 1.0
    gap_opacity = dict[float, torch.Tensor]()
    for confidence in (1.0, 0.9):
        torn = replace(photo, mask=mask, pixels=pixels, mask_confidence=confidence)
        *_, last = fit(tiny, FitJob((torn,), replace(FREE, free_steps=20)))
        rendered = render_image(last.instance.with_detail(None), camera)
        gap_opacity[confidence] = rendered.opacity[photo.mask & ~mask]
    assert float(gap_opacity[0.9].mean()) > float(gap_opacity[1.0].mean()) + 0.05


def test_an_object_of_a_photograph_keeps_nearer_to_its_codes():
    model = load_model("chairs")  # imagined views would make surfaces of the mist that a random network is
    camera = model.camera(0.5, 0.4).resized(64, 64)
    photo = replace(photo_of(model[3], camera), camera=camera)
    sizes = []
    for changed in (replace(photo, mask_confidence=0.99), replace(photo, cropped=True), photo):
        *_, last = fit(model, FitJob((changed,), replace(FREE, samples=48)))
        assert last.instance.codes.shape_offsets is not None
        sizes.append(float(last.instance.codes.shape_offsets.float().square().mean()))
    assert max(sizes[:2]) < 0.8 * sizes[2]
