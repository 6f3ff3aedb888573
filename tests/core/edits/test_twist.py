"""A new kind of edit, in this file alone: a twist about the vertical axis."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import pytest
import torch
from jaxtyping import Float
from torch import Tensor

from core.detail.progressive import render_frame
from core.editing.size import size_of, sized
from core.edits.bend import Bend
from core.edits.edit import Edit
from core.edits.kinds import KINDS
from core.export.mesh import extract_mesh
from core.gl.baking import bake
from core.metrics import psnr
from core.models.model import Instance, Model
from core.models.scene import Scene
from core.rendering.fast import render
from core.rendering.folded_field import FoldedField
from core.rendering.occupancy import shape_occupancy
from core.rendering.reference import render_exact
from core.rendering.surface import surface_points
from core.streams import run_to_end
from tests.conftest import offscreen
from tests.core.baked_reference import render_baked
from tests.core.detail.test_maps import striped

SIZE = 192


@dataclass(frozen=True)
class Twist(Edit):
    """A turn about the vertical axis that grows with the height."""

    turn: float  # rad per scene unit

    key = "twist"
    subject = "shape"
    glsl = """
uniform float twist;
vec3 twist_origins(vec3 point) {
    float c = cos(twist * point.z), s = sin(twist * point.z);
    return vec3(c * point.x + s * point.y, c * point.y - s * point.x, point.z);
}
"""

    def origins(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        x, y, z = points.unbind(-1)
        angle = self.turn * z
        return torch.stack((angle.cos() * x + angle.sin() * y, angle.cos() * y - angle.sin() * x, z), -1)

    def uniforms(self) -> dict[str, Any]:
        return {"twist": self.turn}

    @classmethod
    def between(cls, first: "Twist | None", second: "Twist | None", amount: float) -> "Twist":
        start, end = (edit.turn if edit else 0.0 for edit in (first, second))
        return Twist((1 - amount) * start + amount * end)


@pytest.fixture(autouse=True)
def row() -> Iterator[None]:
    """The row of the table."""
    KINDS[Twist.key] = Twist
    yield
    del KINDS[Twist.key]


@pytest.fixture
def twisted(tiny: Model) -> Instance:
    return tiny[0].with_edits(Twist, Twist(1.5))


def test_renders_and_bakes_agree(tiny: Model, twisted: Instance) -> None:
    camera = tiny.camera(0.7, 0.4).resized(64, 64)
    bent = twisted.with_edits(Bend, Bend(-0.35, -0.05, 0.1, 0.35))
    for instance in (twisted, bent):
        exact = render_exact(instance, camera)
        assert psnr(render(instance, camera, 192).colour, exact.colour) > 40
        *_, baked = filter(None, bake(instance))
        assert psnr(render_baked(baked, camera).colour, exact.colour) > 38
        assert psnr(render_exact(tiny[0], camera).colour, exact.colour) < 32


def test_meshes_and_surface_points_are_twisted(twisted: Instance) -> None:
    vertices = torch.from_numpy(run_to_end(extract_mesh(twisted, 48)).vertices)
    field, plain = (FoldedField.of(instance) for instance in (twisted, twisted.unmoved))
    torch.testing.assert_close(field.density(vertices)[0], plain.density(Twist(1.5).origins(vertices))[0])
    for points in (vertices, surface_points(twisted)[0]):
        assert float(shape_occupancy(twisted).contains(points).float().mean()) > 0.99


def test_photo_detail_follows_on_both_processors(tiny: Model) -> None:
    camera = tiny.camera(1.1, 0.3).resized(SIZE, SIZE)
    instance = striped(tiny, camera).with_edits(Twist, Twist(0.6))
    *_, shadowed = filter(None, bake(instance))
    baked = replace(shadowed, shadow=None)
    with offscreen((SIZE, SIZE)) as pictures:
        drawn, bare = (pictures.draw(field, camera) / 255 for field in (baked, replace(baked, detail=None)))
    looked_up = render_baked(baked, camera).colour.numpy()
    assert abs(drawn - looked_up).mean() < abs(drawn - bare).mean() / 4
    rendered = render_frame(instance, camera).image / 255
    assert abs(rendered - looked_up).mean() < abs(rendered - render_frame(tiny[0], camera).image / 255).mean() / 4


def test_scenes_hold_it(twisted: Instance) -> None:
    text = Scene(twisted, twisted.model.camera(0.0, 0.0)).to_json()
    assert Scene.from_json(text, twisted.model).instance == twisted != twisted.unmoved
    content = json.loads(text)
    content["twist"]["turn"] = "far"
    with pytest.raises(ValueError, match=r"twist\.turn must be a finite number"):
        Scene.from_json(json.dumps(content), twisted.model)


def test_it_is_mixed_and_goes_with_the_shape(tiny: Model, twisted: Instance) -> None:
    assert twisted.mixed(tiny[1], 0.5, 0.0).codes.edits == (Twist(0.75),)
    assert tiny[1].with_shape(twisted).codes.edits == (Twist(1.5),) and tiny[1].with_texture(twisted) != twisted


def test_it_is_sized_as_it_is(twisted: Instance) -> None:
    width, depth, height = size_of(twisted)
    assert (width, depth) != pytest.approx(size_of(twisted.unmoved)[:2], rel=1e-3)
    assert size_of(sized(twisted, width=width, depth=depth, height=1.2 * height))[2] == pytest.approx(1.2 * height)
