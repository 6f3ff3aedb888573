from collections.abc import Callable

import pytest
import torch

from core.detail.progressive import RenderSettings
from core.models.codes import CodeBook, Entry
from core.models.model import Model
from core.rendering.fast import render
from core.rendering.images import render_image
from core.rendering.reference import render_exact
from tests.conftest import random_model
from tests.core.models.test_architecture_variants import build


def entangled() -> Model:
    codes = CodeBook(torch.randn(1, 8), torch.randn(1, 4), (Entry("a", 0, 0),))
    return Model(build("M2"), codes, (0.4, 0.4, 0.4), "chairs", 8, 8.0, 2.0)


@pytest.mark.parametrize("make_model", [lambda: random_model(1, white_from_network=True), entangled])
def test_models_that_the_fast_renderer_does_not_support_are_rendered_exactly(make_model: Callable[[], Model]):
    model = make_model()
    camera = model.camera(0.4, 0.3)
    expected = render_exact(model[0], camera, 64)
    assert torch.equal(render_image(model[0], camera).colour, expected.colour)


def test_other_models_are_rendered_fast(tiny: Model):
    camera = tiny.camera(0.4, 0.3)
    for samples in (None, 32):
        expected = render(tiny[0], camera, samples or RenderSettings().samples)
        assert torch.equal(render_image(tiny[0], camera, samples).colour, expected.colour)
