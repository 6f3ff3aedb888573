"""Preferences and models of former versions; projects and scenes are tested where they are read."""

from pathlib import Path

import pytest

from core.models.model import Model
from tests.conftest import random_model
from viewer.values.preferences import Preferences

_FOLDER = Path(__file__).parents[2] / "files"
_COMMITS = sorted(path.parent.name for path in _FOLDER.glob("*/model.safetensors"))


@pytest.mark.parametrize("commit", _COMMITS)
def test_preferences_of_earlier_versions_are_kept(commit: str) -> None:
    preferences = Preferences.load(_FOLDER / commit)
    assert not preferences.dark
    assert preferences.recent == ("/photos/chair.png",)


@pytest.mark.parametrize("commit", _COMMITS)
def test_models_of_earlier_versions_open(commit: str) -> None:
    old = Model.load(_FOLDER / commit / "model.safetensors")
    now = random_model()
    assert (old.category, old.image_size, old.focal, old.extent) == (
        now.category,
        now.image_size,
        now.focal,
        now.extent,
    )
    assert old.codes.mean.shape.shape == now.codes.mean.shape.shape
