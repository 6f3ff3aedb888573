import pytest
import torch

from core.fitting.biases import bias_jacobians, hypothesis_biases, hypothesis_cells
from core.fitting.gauss_newton import normal_equations
from core.fitting.hypotheses import Parameters
from core.fitting.objective import evaluate_objective
from core.models.latents import Latents
from core.models.model import Model
from core.runtime.precision import use_dtype
from tests.core.fitting.inputs import pixels_of, random_parameters, seeded
from tests.core.fitting.test_gauss_newton import OBJECTIVE, STAGE


def origin_of(model: Model) -> Latents:
    return Latents(model.codes[1].shape, model.codes[1].texture)


def free_parameters(model: Model, count: int = 2, scale: float = 0.3) -> Parameters:
    generator = seeded(3)
    parameters = random_parameters(count)
    shape, texture = (scale * torch.randn(count, std.numel(), generator=generator) for std in model.bias_std)
    return parameters._replace(shape=shape, texture=texture)


def test_offsets_of_zero_are_the_codes_themselves(tiny: Model):
    parameters = free_parameters(tiny, scale=0.0)
    origin = origin_of(tiny)
    for free, folded in zip(hypothesis_biases(tiny, parameters, origin), tiny.biases(origin), strict=True):
        assert torch.equal(free, folded.expand_as(free))
    coordinates = tiny.codes.shape_space.coordinates(origin.shape), tiny.codes.texture_space.coordinates(origin.texture)
    coded = parameters._replace(shape=coordinates[0].expand(2, -1), texture=coordinates[1].expand(2, -1))
    pairs = zip(hypothesis_biases(tiny, parameters, origin), hypothesis_biases(tiny, coded), strict=True)
    for by_offsets, by_codes in pairs:
        torch.testing.assert_close(by_offsets, by_codes, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("free", [False, True])
def test_bias_jacobians_are_those_of_autograd(tiny: Model, free: bool):
    origin = origin_of(tiny) if free else None
    parameters = free_parameters(tiny) if free else random_parameters(2)
    with use_dtype(torch.float32):
        jacobians_by_hand = bias_jacobians(tiny, parameters, origin)
    for number, jacobian in enumerate(jacobians_by_hand):
        code = parameters[4 + number][:1]

        def biases(code: torch.Tensor, number: int = number) -> torch.Tensor:
            moved = Parameters(*(values[:1] for values in parameters))._replace(**{("shape", "texture")[number]: code})
            return hypothesis_biases(tiny, moved, origin)[number][0]

        expected = torch.autograd.functional.jacobian(biases, code)[:, :, 0]
        if free:  # each bias is a number of its own
            jacobian = torch.diag_embed(jacobian.flatten(1)).unflatten(1, jacobian.shape[1:])
        torch.testing.assert_close(jacobian[0], expected, atol=1e-5, rtol=1e-4)


def test_free_gradients_are_those_of_autograd(tiny: Model):
    pixels = pixels_of(tiny)
    parameters = free_parameters(tiny, 1)
    origin = origin_of(tiny)
    stage = STAGE._replace(samples=12)
    with use_dtype(torch.float32):
        equations = normal_equations(tiny, parameters, pixels, None, stage, OBJECTIVE, None, origin)
        free = Parameters(*(values.clone().requires_grad_() for values in parameters))
        value = evaluate_objective(tiny, free, pixels, stage.samples, OBJECTIVE, origin=origin).objective
        value.sum().backward()
    by_autograd = torch.cat((free.shape.grad, free.texture.grad), 1) / 2
    by_hand = equations.gradient[:, 8:]
    cosine = torch.nn.functional.cosine_similarity(by_autograd, by_hand)
    assert float(cosine) > 0.97  # few samples of a ray are differentiated


def test_cells_are_those_of_the_free_shape(tiny: Model):
    origin = origin_of(tiny)
    fitted, moved = (hypothesis_cells(tiny, free_parameters(tiny, 1, scale), origin) for scale in (0.0, 2.0))
    assert fitted is not None and moved is not None
    assert not torch.equal(fitted, moved)
