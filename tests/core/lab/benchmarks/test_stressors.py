import math

import numpy as np
import pytest

from core.lab.benchmarks.stressors import STRESSORS
from tests.core.tiny import tiny_model


def cutout() -> np.ndarray:
    """Return an object of one colour on white."""
    image = np.ones((40, 40, 4), np.float32)
    image[..., 3] = 0
    image[10:30, 12:28] = (0.2, 0.4, 0.6, 1)
    return image


@pytest.mark.parametrize("name", [name for name in STRESSORS if name != "frontal"])
def test_every_level_gives_another_valid_image(name: str):
    stressor = STRESSORS[name]
    images = [stressor.corrupt(cutout(), level, np.random.default_rng(0)) for level in stressor.levels]
    for image in images:
        assert image.shape[-1] in (3, 4)
        assert image.dtype == np.uint8 or 0 <= image.min() <= image.max() <= 1
    assert len({image.tobytes() for image in images}) == len(images)
    assert np.array_equal(images[0], cutout()) == (name in ("none", "another category"))


def test_masks_and_cameras_change_by_the_level():
    for pixels, sides in ((-2.0, (16, 12)), (2.0, (24, 20))):
        mask = STRESSORS["mask"].corrupt(cutout(), pixels, np.random.default_rng(0))[..., 3]
        assert (int(mask.any(1).sum()), int(mask.any(0).sum())) == sides
    camera = tiny_model().camera(0.3, 0.2)
    behind = STRESSORS["frontal"].camera(camera, 180.0)
    assert (behind.azimuth, behind.elevation) == (pytest.approx(3 * math.pi / 2), pytest.approx(0.0873, abs=1e-4))


@pytest.mark.parametrize("least", [0.2, 0.4, 0.6])
@pytest.mark.parametrize("seed", range(5))
def test_discs_hide_a_fraction_within_their_band(least: float, seed: int):
    image = STRESSORS["hidden"].corrupt(cutout(), least, np.random.default_rng(seed))
    hidden = 1 - image[..., 3].sum() / cutout()[..., 3].sum()
    assert least - 0.03 <= hidden <= least + 0.3
    assert np.array_equal(image[image[..., 3] > 0.5], cutout()[image[..., 3] > 0.5])
