from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from core.fitting.fit import PRESETS
from core.fitting.settings import FitSettings
from core.lab.benchmarks import figures
from core.lab.benchmarks.figures import FittedPhoto, fit_photo, write_figures
from core.models.model import Model
from tests.conftest import image_size
from tests.core.tiny import photo_of, tiny_bank, tiny_model

SIDE, LABEL = 160, 18
QUICK = FitSettings(hypotheses=4, steps=12, rays=64, samples=16, max_restarts=0)


@pytest.fixture(scope="module")
def fitted(tiny: Model) -> list[FittedPhoto]:
    """Two stools, seen from two sides."""
    photos = [photo_of(tiny, tiny.codes[index], tiny.camera(0.5 + index, 0.4)) for index in (0, 3)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(figures.PRESETS, "normal", replace(PRESETS["normal"], **vars(QUICK)))
        return [fit_photo(tiny, tiny_bank(), photo) for photo in photos]


def cell(path: Path, row: int, column: int) -> np.ndarray:
    left, top = column * SIDE, row * (SIDE + LABEL) + LABEL
    with Image.open(path) as figure:
        return np.asarray(figure.convert("RGB"))[top : top + SIDE, left : left + SIDE]


def test_figures_of_two_photos_show_fit_edits_grid_and_interpolation(fitted: list[FittedPhoto], tmp_path: Path):
    paths = {path.stem: path for path in write_figures(tiny_model(), fitted, tmp_path / "new")}
    assert set(paths) == {"fit", "edited", "grid", "interpolation"}
    sizes = {name: image_size(path) for name, path in paths.items()}
    assert sizes["grid"] == (3 * SIDE, 3 * (SIDE + LABEL))
    assert sizes["interpolation"] == (8 * SIDE, 3 * (SIDE + LABEL))
    assert sizes["edited"] == (5 * SIDE, 2 * (SIDE + LABEL))
    # Both ends of all three paths are the two objects and mixtures of them, seen from one viewpoint.
    shape, texture, both = ([cell(paths["interpolation"], row, column) for column in range(1, 7)] for row in range(3))
    assert np.array_equal(shape[0], texture[0]) and np.array_equal(shape[0], both[0])
    assert np.array_equal(both[-1], cell(paths["grid"], 2, 2))
    assert np.array_equal(shape[-1], cell(paths["grid"], 2, 1))
    assert np.array_equal(texture[-1], cell(paths["grid"], 1, 2))
    assert np.array_equal(cell(paths["edited"], 0, 1), both[0])


def test_a_single_photo_is_edited_towards_a_training_object(fitted: list[FittedPhoto], tmp_path: Path):
    paths = list(write_figures(tiny_model(), fitted[:1], tmp_path))
    assert [path.stem for path in paths] == ["fit", "edited"]
    assert not np.array_equal(cell(paths[1], 0, 1), cell(paths[1], 0, 3))


def test_no_photo_is_refused(tmp_path: Path):
    with pytest.raises(ValueError, match="no photo"):
        list(write_figures(tiny_model(), [], tmp_path))
