"""Imagined views add their gradient to that of the photos' objective, and clear a hazy object."""

from dataclasses import replace

import torch

from core.fitting.descent import refine, score
from core.fitting.gauss_newton import normal_equations
from core.fitting.hypotheses import HypothesisBatch, Parameters
from core.fitting.imagined import ImaginedViews, add_imagined, imagined_error
from core.fitting.objective import Objective
from core.fitting.schedule import Stage
from core.models.latents import Latents
from core.models.library import load_model
from core.models.model import Model
from core.rendering.folded_layers import AxisLookup
from core.runtime.precision import use_dtype
from tests.core.fitting.inputs import QUICK, pixels_of, problem_of, random_parameters, seeded
from tests.core.tiny import photo_of


def test_the_equations_have_the_value_and_gradient_of_autograd(tiny: Model, monkeypatch):
    monkeypatch.setattr(AxisLookup, "__call__", AxisLookup.evaluate)
    stage = Stage(3, 1, 96, 2, 1.0, 0.3)  # with two samples a ray, all of them are differentiated by both
    views = ImaginedViews.random(tiny, 2, 64, seeded())
    parameters = random_parameters()
    with use_dtype(torch.float32):
        before, after = (
            normal_equations(tiny, parameters, pixels_of(tiny), None, stage, Objective(1e-4)) for _ in range(2)
        )
        add_imagined(after, tiny, parameters, views, stage, None, None)
        codes = [code.requires_grad_() for code in (parameters.shape, parameters.texture)]
        error = imagined_error(tiny, parameters, views, stage.samples, None, None)
    torch.testing.assert_close(after.objective - before.objective, error.detach(), rtol=1e-3, atol=1e-6)
    added = after.gradient - before.gradient
    expected = torch.cat(torch.autograd.grad(error.sum(), codes), 1)
    assert bool(expected.any())
    torch.testing.assert_close(2 * added[:, 8:], expected, rtol=1e-3, atol=1e-3 * float(expected.abs().max()))
    assert not bool(added[:, :8].any())  # the cameras of the photos do not move by them
    assert torch.equal(after.hessian[:, :8], before.hessian[:, :8])


def test_steps_by_imagined_views_alone_clear_a_hazy_object():
    """The photo has no weight, so only its background is left to explain."""
    model = load_model("chairs")
    hazy = model[3].mixed(model[40], 0.5, 0.5)
    camera = model.camera(0.5, 0.4).resized(64, 64)
    problem = problem_of(model, photo_of(hazy, camera), settings=replace(QUICK, code_prior=0.0)).without(0)
    origin = Latents(hazy.codes.shape, hazy.codes.texture)
    problem = replace(problem, origin=origin, imagined=ImaginedViews.random(model, 8, 64, seeded()))
    offsets = (torch.zeros(1, std.numel()) for std in model.bias_std)
    zeros = torch.zeros(1, 1)
    start = HypothesisBatch.of(Parameters(torch.zeros(1, 1, 2), zeros, zeros, torch.zeros(1, 1, 4), *offsets))
    *_, best = refine(problem, score(problem, start, 0.2), Stage(1, 16, 192, 24, 0.2, 0.3), seeded())
    unseen = ImaginedViews.random(model, 16, 128, seeded(1))
    before, after = (
        float(imagined_error(model, batch.parameters, unseen, 48, None, origin)) for batch in (start, best)
    )
    assert after < 0.8 * before
