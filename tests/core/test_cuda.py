"""A graphics card agrees with the processor, to tolerances that say what may differ: ``python -m pytest -m cuda``."""

import copy
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import torch

from core.fitting.fit import FitJob, FitSettings, fit
from core.gl.baked_field import BakedField
from core.gl.baking import bake
from core.lab.datasets.srn import Dataset
from core.lab.training.trainer import Trainer
from core.metrics import psnr, rotation_error
from core.models.library import load_model
from core.models.model import Model
from core.rendering.fast import render
from core.rendering.reference import render_exact
from core.runtime.precision import use_dtype
from tests.core.lab.evaluation.test_protocol import views_of
from tests.core.lab.training.test_trainer import SETTINGS
from tests.core.tiny import photo_of, tiny_model

pytestmark = [
    pytest.mark.cuda,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="torch finds no graphics card"),
]


@pytest.fixture(autouse=True)
def _float32() -> Iterator[None]:
    """Float32 on both devices; one test asks for bfloat16."""
    with use_dtype(torch.float32):
        yield


def on_card(model: Model) -> Model:
    return replace(model, field=copy.deepcopy(model.field).to("cuda"))


def test_exact_renders_are_the_same():
    """Sums in another order: the last digits of float32, larger where a density is."""
    model = tiny_model()
    cpu, gpu = (render_exact(tiny[1], tiny.camera(0.7, 0.4)) for tiny in (model, on_card(model)))
    torch.testing.assert_close(gpu.colour.cpu(), cpu.colour, rtol=0, atol=2e-3)
    torch.testing.assert_close(gpu.opacity.cpu(), cpu.opacity, rtol=0, atol=2e-3)


@pytest.mark.parametrize("name", ["chairs", "cars"])
@pytest.mark.parametrize(("dtype", "least"), [(torch.float32, 45.0), (torch.bfloat16, 35.0)])
def test_shipped_objects_render_the_same(name: str, dtype: torch.dtype, least: float):
    with use_dtype(dtype):
        models = (load_model(name, device) for device in ("cpu", "cuda"))
        cpu, gpu = (render(model[3], model.camera(0.7, 0.4), 96) for model in models)
    assert psnr(gpu.colour.cpu().clamp(0, 1), cpu.colour.clamp(0, 1)) > least


def test_a_fit_finds_the_same_camera_and_explains_the_photo_as_well():
    model = tiny_model()
    truth = model.camera(1.2, 0.3)
    photo = photo_of(model[0], truth)
    settings = FitSettings(hypotheses=8, steps=60, rays=128, samples=24, max_restarts=0)
    cpu, gpu = (list(fit(tiny, FitJob((photo,), settings)))[-1] for tiny in (model, on_card(model)))
    assert rotation_error(cpu.cameras[0], truth) < 10
    assert rotation_error(gpu.cameras[0], truth) < 10
    assert gpu.psnr > 30
    assert gpu.psnr == pytest.approx(cpu.psnr, abs=3)


def test_bakes_differ_by_at_most_one_step_of_a_byte():
    def baked(model: Model) -> BakedField:
        return next(volume for volume in bake(model[0]) if volume is not None)

    cpu = baked(tiny_model())
    gpu = baked(on_card(tiny_model()))
    occupied = (cpu.distance == 0) == (gpu.distance == 0)
    assert occupied.mean() > 0.999  # a corner whose density is just at the limit may fall on either side
    difference = np.abs(cpu.texels.astype(int) - gpu.texels).max(-1)
    assert (difference <= 1).mean() > 0.995


def test_training_reaches_the_same_psnr():
    """Rays are drawn by each device's own generator, so that runs differ; only how far they get is compared."""
    model = tiny_model()
    dataset = Dataset(tuple(views_of(model, i, 6) for i in range(2)), "stools", model.image_size, model.focal)
    final_psnrs = []
    for device in ("cpu", "cuda"):
        steps = list(Trainer(dataset, replace(SETTINGS, steps=200), device).steps())
        final_psnrs.append(float(np.mean([step.psnr for step in steps[-50:]])))
        assert final_psnrs[-1] > float(np.mean([step.psnr for step in steps[:20]])) + 1
    assert final_psnrs[1] == pytest.approx(final_psnrs[0], abs=2)
