import torch
from hypothesis import given
from hypothesis import strategies as st

from core.geometry.camera import Camera, pixel_centres
from core.geometry.rays import camera_rays, cast_rays, clip_to_box

EXTENT = torch.tensor([0.3, 0.5, 0.2])


def test_rays_follow_the_conventions_of_axes_and_pixels():
    rays = cast_rays(torch.tensor([16.0, 16.0]), *torch.tensor([0.4, 0.3, 2.0]), 32.0, (32, 32), EXTENT)
    torch.testing.assert_close(rays.directions, torch.nn.functional.normalize(-rays.origins, dim=-1))
    camera = Camera(0.0, 0.0, 2.0, 32.0, 32, 32)  # from +x: right is +y, up is +z
    rays = camera_rays(camera, EXTENT)
    assert rays.directions[16, 31, 1] > 0 > rays.directions[16, 0, 1]
    assert rays.directions[0, 16, 2] > 0 > rays.directions[31, 16, 2]
    centres = pixel_centres(3, 2)
    assert centres.shape == (2, 3, 2)
    assert centres[0, 0].tolist() == [0.5, 0.5]
    assert centres[1, 2].tolist() == [2.5, 1.5]
    near, far = clip_to_box(torch.tensor([2.0, 0.0, 0.0]), torch.tensor([-1.0, 0.0, 0.0]), EXTENT)
    torch.testing.assert_close(torch.stack((near, far)), torch.tensor([1.7, 2.3]))


@given(st.floats(-3, 3), st.floats(-1.5, 1.5))
def test_projection_is_the_inverse_of_casting(azimuth: float, elevation: float):
    camera = Camera(azimuth, elevation, 2.0, 70.0, 64, 48)
    rays = camera_rays(camera, EXTENT)
    points = rays.origins + 1.7 * rays.directions
    torch.testing.assert_close(camera.project(points), pixel_centres(64, 48), atol=1e-3, rtol=0)


def test_opengl_projects_to_the_same_pixels_and_gradients_reach_the_camera():
    camera = Camera(0.7, -0.3, 2.0, 70.0, 64, 48)
    points = torch.randn(20, 3, generator=torch.Generator().manual_seed(0)) / 4
    homogeneous = torch.nn.functional.pad(points, (0, 1), value=1.0)
    clip = homogeneous @ torch.from_numpy(camera.clip_from_world(1.0, 3.0)).T
    x, y, depth = (clip[:, :3] / clip[:, 3:]).unbind(-1)
    torch.testing.assert_close(camera.project(points), torch.stack((32 + 32 * x, 24 - 24 * y), -1), atol=1e-3, rtol=0)
    nearer = -camera.to_camera_axes(points)[:, 2]
    assert torch.equal(nearer.argsort(), depth.argsort())

    def first(numbers: torch.Tensor) -> torch.Tensor:
        pixels = torch.tensor([[3.0, 4.0], [20.0, 9.0]], dtype=torch.float64)
        rays = cast_rays(pixels, *numbers, 32.0, (32, 32), EXTENT.double())
        return torch.cat((rays.origins, rays.directions), -1)

    numbers = torch.tensor([0.4, 0.3, 2.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(first, (numbers,))


@given(st.integers(0, 2**32 - 1))
def test_clipped_rays_stay_in_the_box_and_missing_ones_are_empty(seed: int):
    generator = torch.Generator().manual_seed(seed)
    origins = torch.randn(64, 3, generator=generator) * 2
    directions = torch.nn.functional.normalize(torch.randn(64, 3, generator=generator), dim=-1)
    near, far = clip_to_box(origins, directions, EXTENT)
    assert bool((near >= 0).all() and (far >= near).all())
    fractions = torch.linspace(0.01, 0.99, 9)
    inside = origins[:, None] + (near[:, None] + (far - near)[:, None] * fractions)[..., None] * directions[:, None]
    hit = far > near
    assert bool((inside[hit].abs() <= EXTENT + 1e-4).all())
    # Reference: test many points along the ray.
    dense_points = origins[:, None] + torch.linspace(0, 8, 2000)[:, None] * directions[:, None]
    enters = (dense_points.abs() <= EXTENT - 0.02).all(-1).any(-1)
    assert bool((hit | ~enters).all())
