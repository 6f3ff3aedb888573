from dataclasses import replace

import pytest
import torch

from core.geometry.rays import camera_rays, cast_rays
from core.models.model import Model
from core.rendering.reference import render_exact, render_rays
from tests.conftest import random_model


def test_one_ray_is_the_sum_of_the_paper(model: Model):
    instance = model[2]
    samples = 20
    ray = camera_rays(model.camera(0.4, 0.3), model.extent_tensor)[15, 17]
    step = float(ray.far - ray.near) / samples
    light = 1.0
    colour = torch.zeros(3)
    shape_bias = model.field.shape_bias(instance.codes.shape)
    texture_bias = model.field.texture_bias(instance.codes.texture)
    for index in range(samples):
        point = ray.origins + (ray.near + (index + 0.5) * step) * ray.directions
        density, features = model.field.density(point, shape_bias)
        emitted = model.field.colour(features, model.field.direction_bias(ray.directions), texture_bias)
        absorbed = 1 - float(torch.exp(-density * step))
        colour = colour + light * absorbed * emitted
        light = light * (1 - absorbed)
    rendered = render_exact(instance, model.camera(0.4, 0.3), samples)
    torch.testing.assert_close(rendered.colour[15, 17], colour + light, atol=1e-5, rtol=1e-5)
    assert float(rendered.opacity[15, 17]) == pytest.approx(1 - light, abs=1e-5)


def test_rays_beside_the_box_are_white_and_samples_converge(model: Model, tiny: Model):
    rendered = render_exact(model[0], model.camera(0.4, 0.3), 8)
    assert rendered.colour[0, 0].tolist() == [1, 1, 1]
    assert rendered.opacity[0, 0] == 0
    assert rendered.depth[0, 0] == 0
    camera = tiny.camera(0.4, 0.3)
    fine = render_exact(tiny[0], camera, 256).colour
    errors = [float((render_exact(tiny[0], camera, n).colour - fine).abs().mean()) for n in (8, 32, 128)]
    assert errors[0] > 3 * errors[1] > 9 * errors[2]


@pytest.mark.parametrize("name", ["azimuth", "elevation", "distance", "shape", "texture"])
def test_gradients_of_rendered_rays_match_finite_differences(name: str, monkeypatch: pytest.MonkeyPatch):
    # The field converts to float32 for autocast, which would lose the digits that the differences need.
    monkeypatch.setattr(torch.Tensor, "float", torch.Tensor.double)
    model = random_model(2)
    field = model.field.double()
    generator = torch.Generator().manual_seed(1)
    pixels = 12 + 8 * torch.rand(6, 2, generator=generator, dtype=torch.float64)
    target = torch.rand(6, 3, generator=generator, dtype=torch.float64)
    extent = model.extent_tensor.double()
    pose = {"azimuth": 0.7, "elevation": 0.4, "distance": 2.0}
    values = {key: torch.tensor(value, dtype=torch.float64) for key, value in pose.items()}
    values |= {"shape": model.codes[0].shape.double(), "texture": model.codes[0].texture.double()}
    with torch.no_grad():
        fixed = cast_rays(pixels, *(values[key] for key in pose), 32.8, (32, 32), extent)

    def loss(changed: torch.Tensor) -> torch.Tensor:
        inputs = values | {name: changed}
        rays = cast_rays(pixels, *(inputs[key] for key in pose), 32.8, (32, 32), extent)
        # Depths of samples are constants: the gradient does not pass through the ends of rays.
        rays = replace(rays, near=fixed.near, far=fixed.far)
        rendered = render_rays(
            model, rays, 12, field.shape_bias(inputs["shape"]), field.texture_bias(inputs["texture"])
        )
        return (rendered.colour - target).square().sum()

    assert float(fixed.far.sub(fixed.near).min()) > 0.1
    start = values[name].clone().requires_grad_()
    (slope,) = torch.autograd.grad(loss(start), start)
    direction = torch.randn(slope.shape, generator=generator, dtype=torch.float64)
    step = 1e-5
    with torch.no_grad():
        measured = (loss(values[name] + step * direction) - loss(values[name] - step * direction)) / (2 * step)
    assert float((slope * direction).sum()) == pytest.approx(float(measured), rel=1e-5, abs=1e-9)
