"""Training and held-out objects (``assets/held_out.json``), and each split's cameras."""

import json
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from core.geometry.camera import Camera
from core.lab.datasets.categories import Split, category_sizes
from core.lab.datasets.srn_cameras import spiral_views, training_views

_HELD_OUT = Path(__file__).resolve().parents[3] / "assets" / "held_out.json"


_Item = TypeVar("_Item")


def evenly_spaced(items: Sequence[_Item], count: int | None) -> tuple[_Item, ...]:
    """Return ``count`` evenly spaced items, or all if ``count`` is None or larger.

    Example:
        >>> evenly_spaced("abcdef", 3)
        ('a', 'c', 'e')
    """
    count = len(items) if count is None else min(count, len(items))
    return tuple(items[index * len(items) // count] for index in range(count))


def held_out_meshes(category: str) -> dict[Split, frozenset[str]]:
    """Return the names of meshes excluded from training, of the validation and the test split."""
    lists = json.loads(_HELD_OUT.read_text())
    held: tuple[Split, ...] = ("validation", "test")
    return {split: frozenset(lists[split].get(category, ())) for split in held}


def split_cameras(split: Split, count: int, name: str, category: str, size: int) -> tuple[Camera, ...]:
    """Return SRN's cameras of a split. Training views depend only on the object's name."""
    distance = category_sizes(category).distance
    if split != "train":
        return spiral_views(count, distance, size)
    generator = np.random.default_rng(zlib.crc32(name.encode()))
    return training_views(count, generator, distance, size)
