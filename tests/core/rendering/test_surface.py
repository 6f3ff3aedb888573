import torch

from core.models.model import Model
from core.rendering.surface import surface_points
from tests.core.tiny import EXTENT


def test_points_lie_on_the_surface_with_its_colours_from_outside(tiny: Model):
    points, colours = surface_points(tiny[3])
    assert len(points) > 500
    assert bool((points.abs() < EXTENT[0]).all())
    assert 0 <= float(colours.min()) <= float(colours.max()) <= 1
    instance = tiny[2]
    points, _ = surface_points(instance)
    cell = 2 * max(EXTENT) / 40
    around = points[:, None] + cell * torch.cartesian_prod(*[torch.tensor((0.0, 1.0, -1.0))] * 3)
    with torch.no_grad():
        thickness = cell * tiny.field.density(around.flatten(0, 1), tiny.field.shape_bias(instance.codes.shape))[0]
    thickness = thickness.reshape(len(points), 27)
    assert float((thickness[:, 0] > 0.45).float().mean()) > 0.98
    assert float((thickness[:, 1:].amin(1) < 0.55).float().mean()) > 0.98
    instance = tiny[1]
    points, colours = surface_points(instance)
    field = tiny.field
    with torch.no_grad():
        _, expected = field.radiance(
            points,
            field.direction_bias(-torch.nn.functional.normalize(points, dim=-1)),
            field.shape_bias(instance.codes.shape),
            field.texture_bias(instance.codes.texture),
        )
    torch.testing.assert_close(colours, expected.clamp(0, 1), atol=0.05, rtol=0.0)
