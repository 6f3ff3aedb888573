import dataclasses

import pytest
import torch

from core.models.architecture_variants import build_field
from core.models.codes import CodeBook, Entry
from core.models.field import Field, encode
from core.models.field_config import FieldConfig
from core.models.model import Model
from core.rendering.fast import render
from core.rendering.reference import render_exact
from tests.core.models.test_model import reloaded

CONFIG = FieldConfig(32, 2, 1, 8, 4, position_frequencies=3, direction_frequencies=2)
POINTS = torch.rand(50, 3, generator=torch.Generator().manual_seed(0)) - 0.5


def build(architecture: str) -> Field:
    torch.manual_seed(1)
    return build_field(dataclasses.replace(CONFIG, architecture=architecture))


def evaluated(field: Field, direction: torch.Tensor, shape: torch.Tensor, texture: torch.Tensor):
    towards = field.direction_bias(torch.nn.functional.normalize(direction, dim=-1))
    return field.radiance(POINTS, towards, *field.biases(shape, texture))


@pytest.mark.parametrize(
    ("architecture", "by_direction", "by_texture"),
    [("codenerf", False, False), ("M1", True, False), ("M2", False, True)],
)
def test_density_depends_on_direction_and_texture_by_architecture(
    architecture: str, by_direction: bool, by_texture: bool
):
    field = build(architecture)
    original = evaluated(field, torch.tensor([1.0, 0, 0]), torch.ones(8), torch.ones(4))
    turned = evaluated(field, torch.tensor([0, 1.0, 0]), torch.ones(8), torch.ones(4))
    repainted = evaluated(field, torch.tensor([1.0, 0, 0]), torch.ones(8), -torch.ones(4))
    assert torch.equal(original[0], turned[0]) is not by_direction
    assert torch.equal(original[0], repainted[0]) is not by_texture
    assert not torch.equal(original[1], turned[1])
    assert not torch.equal(original[1], repainted[1])


def test_m1_sees_point_and_direction_from_outside_without_one():
    field = build("M1")
    direction = torch.tensor([0.6, 0.8, 0.0])
    joint = torch.cat((field.point_layer.weight, field.early_direction.weight), 1)
    both = torch.cat((encode(POINTS, 3), encode(direction, 2).expand(50, -1)), -1)
    shape_bias, _ = field.biases(torch.ones(8), torch.ones(4))
    first = torch.nn.functional.linear(both, joint, field.point_layer.bias).relu()
    density, _ = field.density_from_activations(first, shape_bias)
    radiance = evaluated(field, direction, torch.ones(8), torch.ones(4))
    torch.testing.assert_close(radiance[0], density)
    for index, point in enumerate(POINTS[:5]):
        inward = evaluated(field, -point, torch.ones(8), torch.ones(4))[0][index]
        torch.testing.assert_close(field.density(point, shape_bias)[0], inward)
    with pytest.raises(ValueError, match="architecture: M3"):
        dataclasses.replace(CONFIG, architecture="M3")


@pytest.mark.parametrize("architecture", ["M1", "M2"])
def test_a_model_of_another_architecture_is_kept_and_rendered_exactly_only(architecture: str, tmp_path):
    codes = CodeBook(torch.randn(2, 8), torch.randn(2, 4), (Entry("a", 0, 0), Entry("b", 1, 1)))
    model = reloaded(Model(build(architecture), codes, (0.4, 0.4, 0.4), "chairs", 8, 8.0, 2.0), tmp_path)
    first = model[0]
    camera = model.camera(0.3, 0.4)
    drawn = render_exact(first, camera, 8)
    swapped = render_exact(first.with_texture(model[1]), camera, 8)
    assert torch.equal(drawn.opacity, swapped.opacity) is (architecture == "M1")
    with pytest.raises(ValueError, match="--exact"):
        render(first, camera, 8)
