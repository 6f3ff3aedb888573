import torch
from torch import Tensor

from core.geometry.rays import Rays
from core.lab.training.sample_placement import place_samples


def rays(count: int = 50) -> Rays:
    """Along x, through a box of two units."""
    origins = torch.tensor([-2.0, 0.0, 0.0]).expand(count, 3)
    directions = torch.tensor([1.0, 0.0, 0.0]).expand(count, 3)
    return Rays(origins, directions, torch.full((count,), 1.0), torch.full((count,), 3.0))


def two_slabs(points: Tensor) -> Tensor:
    x = points[..., 0]
    return ((x > -0.75) & (x < -0.5)) | ((x > 0.25) & (x < 0.5))


def place(samples: int = 16, density: float | None = None, inside=two_slabs):
    coarse = None if density is None else lambda points: torch.full(points.shape[:-1], density)
    jitter = torch.rand(50, samples, generator=torch.Generator().manual_seed(0))
    return place_samples(rays(), jitter, inside, coarse)


def test_samples_lie_in_the_hull_before_the_light_is_absorbed() -> None:
    placed = place()
    assert bool(two_slabs(placed.points).all())
    torch.testing.assert_close(placed.edges[:, -1], torch.full((50,), 0.5), atol=0.02, rtol=0)
    assert int((placed.points[..., 0] < 0).sum()) == 50 * 8
    assert bool((placed.points[..., 0].diff(dim=-1) >= 0).all())
    opaque = place(density=1000.0)
    assert bool((opaque.points[..., 0] < -0.5).all())
    assert float(opaque.edges[:, -1].max()) < 0.06
    torch.testing.assert_close(place(density=1.0).points, placed.points)
    missing = place(inside=lambda points: torch.zeros(points.shape[:-1], dtype=torch.bool))
    assert float(missing.edges.abs().max()) == 0.0
    assert bool(torch.isfinite(missing.points).all())
