import dataclasses

import pytest
import torch

from core.lab.datasets.srn import Dataset
from core.lab.training.ray_dataset import RayDataset
from tests.core.lab.training.test_visual_hull import ball

EXTENT, CPU = (0.5, 0.5, 0.5), torch.device("cpu")


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    """Three balls of one folder, and one of another."""
    balls = [ball(radius, (0, 0, 0), count=4, size=32) for radius in (0.1, 0.2, 0.2, 0.4)]
    named = (dataclasses.replace(one, name=str(i)) for i, one in enumerate(balls))
    return Dataset(tuple(named), "balls", 32, balls[0].cameras[0].focal, counts=(3, 1))


@pytest.mark.parametrize("shares", [(1.0, 1.0), (3.0, 1.0), (0.1, 0.9)])
def test_every_folder_gets_its_share_of_the_rays(dataset: Dataset, shares: tuple[float, float]) -> None:
    batch = RayDataset(dataset, EXTENT, CPU, False, shares).sample(1000, torch.Generator().manual_seed(0))
    assert int((batch.owner == 3).sum()) == round(1000 * shares[1] / sum(shares))
    assert set(batch.owner.tolist()) == {0, 1, 2, 3}


def test_without_shares_rays_fall_by_pixels(dataset: Dataset) -> None:
    found = RayDataset(dataset, EXTENT, CPU, False)
    batch = found.sample(20_000, torch.Generator().manual_seed(0))
    pixels = torch.bincount(found.owner[found.view.long()]) / len(found.view)
    edges = torch.bincount(found.owner[found.view[found.edges.long()].long()]) / len(found.edges)
    rays = torch.bincount(batch.owner) / 20_000
    torch.testing.assert_close(rays, 0.75 * pixels + 0.25 * edges, atol=0.02, rtol=0)


@pytest.mark.parametrize("shares", [(1.0,), (1.0, 0.0), (1.0, 1.0, 1.0)])
def test_shares_that_do_not_fit_the_folders_are_refused(dataset: Dataset, shares: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="2 datasets need as many positive shares"):
        RayDataset(dataset, EXTENT, CPU, False, shares)


def test_only_pixel_means_lie_across_a_border(dataset: Dataset) -> None:
    means = RayDataset(dataset, EXTENT, CPU, False)
    points = RayDataset(dataclasses.replace(dataset, point_sampled=True), EXTENT, CPU, False)
    assert 1 in means.mask_class
    assert 1 not in points.mask_class
