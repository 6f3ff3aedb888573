import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from core.detail.progressive import render_frame
from core.export.films import View, turntable
from core.export.framing import MARGIN, filling_distance, filling_frame
from core.models.field import Field
from core.models.model import Model
from tests.core.export.test_mesh import tiny  # noqa: F401  (a fixture)


def edges(model: Model, view: View) -> tuple[float, float, float, float]:
    """Return the free fractions of the frame to the left, at the top, to the right and below."""
    opaque = render_frame(view.instance, view.camera).opacity > 0.2
    rows = np.flatnonzero(opaque.any(1))
    columns = np.flatnonzero(opaque.any(0))
    height, width = opaque.shape
    return columns[0] / width, rows[0] / height, 1 - (columns[-1] + 1) / width, 1 - (rows[-1] + 1) / height


@pytest.mark.parametrize("elevation", [0.0, 0.5, 1.5])
def test_a_turntable_fills_its_frame_and_never_leaves_it(tiny: Model, elevation: float):  # noqa: F811
    camera = tiny.camera(0.3, elevation).resized(96, 96)
    views = filling_frame(turntable(tiny[1], camera, 8))
    free = np.array([edges(tiny, view) for view in views])
    assert free.min() > 0  # no pixel at an edge: nothing is cut off
    assert free.min() < 2.5 * MARGIN
    assert len({view.camera.focal for view in views}) == 1
    assert all(view.camera.distance == camera.distance for view in views)


def test_every_shape_of_a_morph_stays_in_sight(tiny: Model):  # noqa: F811
    camera = tiny.camera(0.3, 0.3).resized(96, 96)
    morph = [View(tiny[0].mixed(tiny[3], amount, 0.0), camera) for amount in np.linspace(0, 1, 9)]
    assert min(min(edges(tiny, view)) for view in filling_frame(morph)) > 0


@pytest.mark.parametrize(("size", "elevation"), [((96, 96), 0.0), ((64, 128), 0.5), ((192, 96), 1.5)])
def test_an_object_fills_a_fraction_of_a_frame(tiny: Model, size: tuple[int, int], elevation: float):  # noqa: F811
    camera = tiny.camera(0.3, elevation, 9.0).resized(*size)
    camera = replace(camera, distance=filling_distance(tiny[1], camera, 0.75))
    left, top, right, bottom = edges(tiny, View(tiny[1], camera))
    assert 1 - 2 * min(left, top, right, bottom) == pytest.approx(0.75, abs=0.08)


@pytest.mark.parametrize("aspect", [(64, 128), (128, 64)])
def test_the_narrower_side_of_a_frame_decides_the_size(tiny: Model, aspect: tuple[int, int]):  # noqa: F811
    square, narrow = (
        filling_frame([View(tiny[0], tiny.camera(0.3, 0.3).resized(*size))])[0].camera for size in ((64, 64), aspect)
    )
    assert min(edges(tiny, View(tiny[0], narrow))) > 0
    assert narrow.focal == pytest.approx(square.focal, rel=0.6)


def test_the_box_of_an_empty_object_fills_the_frame(model: Model):
    field = Field(model.field.config)
    torch.nn.init.constant_(field.density_layer.bias, -100.0)
    air = replace(model, field=field)
    (view,) = filling_frame([View(air[0], air.camera(0.0, 0.0))])
    half = math.hypot(0.0, air.extent[2]) * view.camera.focal / (view.camera.distance - air.extent[0])
    assert half == pytest.approx((0.5 - MARGIN) * view.camera.height, rel=1e-4)
