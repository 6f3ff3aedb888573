import numpy as np
import pytest
import torch

from core.geometry.camera import Camera
from core.geometry.rays import camera_rays
from core.lab.datasets.srn import ObjectViews
from core.lab.training.visual_hull import grid_centres, shared_extent, visual_hull


def ball(radius: float = 0.2, centre=(0.1, 0.0, 0.05), count: int = 12, size: int = 64) -> ObjectViews:
    """A ball seen from all around: its mask is where rays pass near its centre."""
    generator = np.random.default_rng(0)
    cameras = list[Camera]()
    masks = list[np.ndarray]()
    for _ in range(count):
        camera = Camera(generator.uniform(-3, 3), generator.uniform(-1.4, 1.4), 2.0, size * 1.02, size, size)
        rays = camera_rays(camera, torch.full((3,), 0.5))
        towards = torch.tensor(centre) - rays.origins
        depth = (towards * rays.directions).sum(-1, keepdim=True)
        masks.append(((towards - depth * rays.directions).norm(dim=-1) < radius).numpy())
        cameras.append(camera)
    images = np.full((count, size, size, 3), 255, np.uint8)
    return ObjectViews("ball", "ball", "ball", images, np.stack(masks), tuple(cameras))


def test_hull_and_extent_hold_the_ball_and_little_else():
    views = ball()
    box = (0.5, 0.5, 0.5)
    hull = visual_hull(views, box, 32).flatten()
    far = (grid_centres(box, 32) - torch.tensor([0.1, 0.0, 0.05])).norm(dim=-1)
    assert bool(hull[far < 0.2].all())
    assert int(hull.sum()) < 3 * int((far < 0.2).sum())
    for half, true_half in zip(shared_extent([views]), (0.3, 0.2, 0.25), strict=True):
        assert true_half <= half < true_half + 0.13
    empty = ObjectViews("none", "none", "none", views.images, np.zeros_like(views.masks), views.cameras)
    with pytest.raises(ValueError, match="rule out all space"):
        shared_extent([empty])
