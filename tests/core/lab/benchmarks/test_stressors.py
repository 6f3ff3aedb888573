import numpy as np
import pytest

from core.lab.benchmarks.stressors import STRESSORS


def cutout() -> np.ndarray:
    """Return an object of one colour on white."""
    image = np.ones((40, 40, 4), np.float32)
    image[..., 3] = 0
    image[10:30, 12:28] = (0.2, 0.4, 0.6, 1)
    return image


@pytest.mark.parametrize("name", STRESSORS)
def test_every_level_gives_another_valid_image(name: str):
    stressor = STRESSORS[name]
    images = [stressor.corrupt(cutout(), level, np.random.default_rng(0)) for level in stressor.levels]
    unchanged = stressor.focal or stressor.stranger or stressor.intruders
    for image in images:
        assert image.shape[-1] == 4 and image.dtype == np.float32
        assert 0 <= image.min() <= image.max() <= 1
        assert np.array_equal(image, cutout()) == bool(unchanged)
        assert (image[image[..., 3] == 0][:, :3] == 1).all() or name == "blur"
    assert unchanged or len({image.tobytes() for image in images}) == len(images)


@pytest.mark.parametrize(("name", "level", "height", "width"), [("dilated", 2, 24, 20), ("legs", 0.2, 16, 16)])
def test_masks_change_by_the_level(name: str, level: float, height: int, width: int):
    mask = STRESSORS[name].corrupt(cutout(), level, np.random.default_rng(0))[..., 3]
    assert (int(mask.any(1).sum()), int(mask.any(0).sum())) == (height, width)


def test_a_neighbour_widens_the_mask_by_its_part():
    joined = STRESSORS["neighbour"].corrupt(cutout(), 0.25, np.random.default_rng(0))
    assert joined.shape == cutout().shape
    assert int(joined[..., 3].any(0).sum()) == 20


def test_exposure_is_of_linear_light():
    darker = STRESSORS["exposure"].corrupt(cutout(), -2.2, np.random.default_rng(0))
    assert darker[15, 15, :3] == pytest.approx([0.1, 0.2, 0.3])


@pytest.mark.parametrize("name", ["occlusion", "holes"])
@pytest.mark.parametrize("fraction", [0.2, 0.6])
@pytest.mark.parametrize("seed", range(3))
def test_discs_remove_about_a_fraction(name: str, fraction: float, seed: int):
    image = STRESSORS[name].corrupt(cutout(), fraction, np.random.default_rng(seed))
    hidden = 1 - image[..., 3].sum() / cutout()[..., 3].sum()
    assert fraction - 0.03 <= hidden <= fraction + 0.1
    assert np.array_equal(image[image[..., 3] > 0.5], cutout()[image[..., 3] > 0.5])
