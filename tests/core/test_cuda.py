"""A graphics card agrees with the processor, to tolerances that say what may differ: ``python -m pytest -m cuda``."""

import copy
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import torch

from core.fitting.fit import FitJob, FitSettings, fit
from core.lab.datasets.srn import Dataset
from core.lab.training.trainer import Trainer
from core.metrics import psnr, rotation_error
from core.models.library import load_model
from core.models.model import Model
from core.rendering.baked_field import BakedField
from core.rendering.baking import bake
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
def single() -> Iterator[None]:
    """In float32 on both; bfloat16 is what one test is about."""
    with use_dtype(torch.float32):
        yield


def on_card(model: Model) -> Model:
    return replace(model, field=copy.deepcopy(model.field).to("cuda"))


def test_exact_renders_are_the_same():
    """Sums in another order: the last digits of float32, larger where a density is."""
    model = tiny_model()
    here, there = (render_exact(one[1], one.camera(0.7, 0.4)) for one in (model, on_card(model)))
    torch.testing.assert_close(there.colour.cpu(), here.colour, rtol=0, atol=2e-3)
    torch.testing.assert_close(there.opacity.cpu(), here.opacity, rtol=0, atol=2e-3)


@pytest.mark.parametrize("name", ["chairs", "cars"])
@pytest.mark.parametrize(("dtype", "least"), [(torch.float32, 45.0), (torch.bfloat16, 35.0)])
def test_shipped_objects_look_the_same(name: str, dtype: torch.dtype, least: float):
    with use_dtype(dtype):
        here, there = (render(one[3], one.camera(0.7, 0.4), 96) for one in (load_model(name), load_model(name, "cuda")))
    assert psnr(there.colour.cpu().clamp(0, 1), here.colour.clamp(0, 1)) > least


def test_a_fit_finds_the_same_camera_and_explains_the_photo_as_well():
    model = tiny_model()
    truth = model.camera(1.2, 0.3)
    photo = photo_of(model[0], truth)
    settings = FitSettings(hypotheses=8, steps=60, rays=128, samples=24, max_restarts=0)
    here, there = (list(fit(one, FitJob((photo,), settings)))[-1] for one in (model, on_card(model)))
    assert rotation_error(here.cameras[0], truth) < 10
    assert rotation_error(there.cameras[0], truth) < 10
    assert there.psnr > 30
    assert there.psnr == pytest.approx(here.psnr, abs=3)


def test_what_is_baked_differs_by_a_step_of_its_bytes():
    def baked(model: Model) -> BakedField:
        return next(one for one in bake(model[0]) if one is not None)

    here, there = baked(tiny_model()), baked(on_card(tiny_model()))
    occupied = (here.distance == 0) == (there.distance == 0)
    assert occupied.mean() > 0.999  # a corner whose density is just at the limit may fall on either side
    off = np.abs(here.texels.astype(int) - there.texels).max(-1)
    assert (off <= 1).mean() > 0.995


def test_training_gets_as_far():
    """Rays are drawn by each device's own generator, so that runs differ; only how far they get is compared."""
    model = tiny_model()
    dataset = Dataset(tuple(views_of(model, i, 6) for i in range(2)), "stools", model.image_size, model.focal)
    ends = []
    for device in ("cpu", "cuda"):
        steps = list(Trainer(dataset, replace(SETTINGS, steps=200), device).steps())
        ends.append(float(np.mean([step.psnr for step in steps[-50:]])))
        assert ends[-1] > float(np.mean([step.psnr for step in steps[:20]])) + 1
    assert ends[1] == pytest.approx(ends[0], abs=2)
