import pytest
import torch

from core.models.field import Field, encode
from core.models.field_config import FieldConfig


def plain(field: Field, point, direction, shape, texture):
    """The architecture figure, layer by layer, with no folding."""
    y = field.point_layer(encode(point, field.config.position_frequencies)).relu()
    for latent, block in zip(field.shape_latent, field.shape_block, strict=True):
        y = block(y + latent(shape).relu()).relu()
    features = field.feature_layer(y)
    density = field.config.density_scale * torch.nn.functional.softplus(field.density_layer(features))[..., 0]
    y = field.direction_layer(torch.cat((features, encode(direction, field.config.direction_frequencies)), -1)).relu()
    for latent, block in zip(field.texture_latent, field.texture_block, strict=True):
        y = block(y + latent(texture).relu()).relu()
    return density, field.colour_layer(field.colour_hidden(y).relu()).sigmoid()


@pytest.mark.parametrize(("shape_blocks", "texture_blocks"), [(1, 1), (2, 1), (3, 2)])
def test_folded_biases_are_the_plain_network(shape_blocks: int, texture_blocks: int):
    torch.manual_seed(1)
    field = Field(FieldConfig(32, shape_blocks, texture_blocks, 8, 4))
    points = torch.rand(50, 3) - 0.5
    directions = torch.nn.functional.normalize(torch.randn(50, 3), dim=-1)
    shape = torch.randn(50, 8)
    texture = torch.randn(50, 4)
    density, features = field.density(points, field.shape_bias(shape))
    colour = field.colour(features, field.direction_bias(directions), field.texture_bias(texture))
    expected = plain(field, points, directions, shape, texture)
    torch.testing.assert_close((density, colour), expected, atol=1e-4, rtol=1e-5)


def test_encodings_and_slopes_of_biases_are_their_formulas():
    encoded = encode(torch.tensor([0.5, 0.0, -1.0]), 2)
    angles = torch.tensor([0.5, 0.0, -1.0, 1.0, 0.0, -2.0])
    torch.testing.assert_close(encoded, torch.cat((torch.tensor([0.5, 0.0, -1.0]), angles.sin(), angles.cos())))
    torch.manual_seed(2)
    field = Field(FieldConfig(32, 2, 1, 8, 4))
    codes = torch.randn(3, 8)
    directions = torch.randn(5, 8)
    unmoved = torch.zeros(3, 5)
    expected = torch.func.vmap(torch.func.jacrev(lambda code, moved: field.shape_bias(code + moved @ directions), 1))
    torch.testing.assert_close(field.shape_bias_jacobian(codes, directions), expected(codes, unmoved))
    expected = torch.func.vmap(
        torch.func.jacrev(lambda code, moved: field.texture_bias(code + moved @ directions[:, :4]), 1)
    )
    torch.testing.assert_close(
        field.texture_bias_jacobian(codes[:, :4], directions[:, :4]), expected(codes[:, :4], unmoved)
    )


@pytest.mark.parametrize("sizes", [{"width": 0}, {"width": 7}, {"shape_blocks": 0}, {"position_frequencies": -1}])
def test_impossible_sizes_are_refused(sizes: dict):
    with pytest.raises(ValueError, match="of a field is"):
        FieldConfig(**sizes)
