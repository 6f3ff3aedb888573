import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from core.geometry.camera import camera_rotation
from core.models.codes import Codes
from core.models.model import Model
from core.photos.view_bank import SIDE, ViewBank, apparent_size, build_view_bank, unpack_bits
from core.rendering.reference import render_exact
from core.rendering.surface import surface_points
from core.runtime.folders import cache_folder
from core.streams import run_to_end
from tests.conftest import random_model
from tests.core.tiny import tiny_bank

PARTS = ("silhouettes", "sizes", "offsets")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache folder of its own."""
    monkeypatch.setenv("CODENERF_CACHE", str(tmp_path))
    return tmp_path


def bank_files(folder: Path) -> list[Path]:
    return list(folder.glob("view-banks/*.safetensors"))


def same(one: ViewBank, other: ViewBank) -> bool:
    return one.codes == other.codes and all(torch.equal(getattr(one, part), getattr(other, part)) for part in PARTS)


def test_apparent_sizes_in_training_images(tiny: Model):
    usual = apparent_size(tiny_bank(), tiny)
    seen = render_exact(tiny, tiny.codes[0], tiny.camera(0.7, 0.4), 32).opacity > 0.5
    size = max(int(seen.any(0).sum()), int(seen.any(1).sum())) / tiny.image_size
    assert usual.min < size < usual.max


def test_a_view_is_what_a_plain_loop_over_the_points_makes_of_them(tiny: Model):
    bank, view, index = tiny_bank(), 2 * 24 + 3, 1
    codes = Codes(bank.codes.shape[index], bank.codes.texture[index])
    points, _ = surface_points(tiny, codes)
    right, up, backward = (camera_rotation(bank.azimuth[view], bank.elevation[view]) @ points.T).tolist()
    seen = [(x / (tiny.distance - z), -y / (tiny.distance - z)) for x, y, z in zip(right, up, backward, strict=True)]
    low, high = (tuple(map(end, zip(*seen, strict=True))) for end in (min, max))
    size = max(high[0] - low[0], high[1] - low[1])
    mask = torch.zeros(SIDE, SIDE)
    for place in seen:
        column, row = (
            min(SIDE - 1, int((value - (one + two) / 2) / size * (SIDE - 2) + SIDE / 2))
            for value, one, two in zip(place, low, high, strict=True)
        )
        mask[row, column] = 1
    assert float(bank.sizes[index, view]) == pytest.approx(size, rel=1e-4)
    assert bank.offsets[index, view].tolist() == pytest.approx(
        [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2], abs=1e-5
    )
    found = unpack_bits(bank.silhouettes[index, view : view + 1]).reshape(SIDE, SIDE)
    assert float((found != mask).float().mean()) < 0.01  # a point between two pixels may be rounded either way


def test_progress_ends_at_one(tiny: Model, folder: Path):
    shares = list(build_view_bank(tiny))
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_the_next_process_reads_the_file(tiny: Model, folder: Path):
    made = run_to_end(build_view_bank(tiny))
    (file,) = bank_files(folder)
    assert tiny.fingerprint in file.name
    assert not list(build_view_bank(tiny))
    assert same(run_to_end(build_view_bank(tiny)), made)


@pytest.mark.parametrize("damage", ["empty", "cut", "other", "numbers"])
def test_a_damaged_file_is_made_again(damage: str, tiny: Model, folder: Path):
    made = run_to_end(build_view_bank(tiny))
    (file,) = bank_files(folder)
    whole = file.read_bytes()
    if damage == "numbers":
        nothing = np.full(made.sizes.numel(), np.nan, np.float32).tobytes()
        damaged = whole.replace(made.sizes.numpy().tobytes(), nothing)
        assert damaged != whole
    else:
        damaged = {"empty": b"", "cut": whole[: len(whole) // 2], "other": b"no view bank at all"}[damage]
    file.unlink()  # which is mapped into memory
    file.write_bytes(damaged)
    assert same(run_to_end(build_view_bank(tiny)), made)
    assert file.read_bytes() == whole


def test_where_nothing_can_be_written_the_bank_is_made_all_the_same(tiny: Model, folder: Path):
    (folder / "view-banks").write_text("a file where the folder should be")
    assert same(run_to_end(build_view_bank(tiny)), tiny_bank())
    assert not bank_files(folder)


def test_an_empty_bank_is_told_where_it_is_used_and_not_kept(folder: Path):
    empty = random_model()
    empty.field.density_layer.bias.fill_(-1e4)
    bank = run_to_end(build_view_bank(empty))
    with pytest.raises(ValueError, match="no objects"):
        apparent_size(bank, empty)
    assert not bank_files(folder)


def test_tests_do_not_write_into_the_folder_of_the_user():
    assert str(cache_folder()) == os.environ["CODENERF_CACHE"]
    words = [sys.executable, "-c", "from core.runtime.folders import cache_folder; print(cache_folder())"]
    bare = {name: value for name, value in os.environ.items() if name != "CODENERF_CACHE"}
    said = subprocess.run(words, env=bare, capture_output=True, text=True, check=True).stdout
    assert Path(said.strip()).name.startswith("codenerf-viewer") or "codenerf-viewer" in said
