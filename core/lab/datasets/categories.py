"""Categories of datasets, the sizes of their objects, and the splits."""

import json
from pathlib import Path
from typing import Literal, NamedTuple, get_args


class Sizes(NamedTuple):
    """Sizes of a category, which models trained on it keep."""

    distance: float  # scene units from cameras to the origin
    metres: float  # longest side of a usual object


_SIZES = {"cars": Sizes(1.3, 4.5), "chairs": Sizes(2.0, 0.9)}
"""Distances as in ShapeNet-SRN, where cameras step back for chairs because they are taller."""
_OTHER = Sizes(1.8, 1.0)  # a sphere of diameter 1 fills half of the image's width

Split = Literal["train", "validation", "test"]
SPLITS: tuple[Split, ...] = get_args(Split)
_HELD_OUT = Path(__file__).resolve().parents[3] / "assets" / "held_out.json"


def category_sizes(category: str) -> Sizes:
    """Return the sizes of a category; defaults for an unknown one."""
    return _SIZES.get(category, _OTHER)


def held_out_meshes(category: str) -> dict[Split, frozenset[str]]:
    """Return the names of meshes excluded from training, of the validation and the test split."""
    lists = json.loads(_HELD_OUT.read_text())
    return {split: frozenset(lists[split].get(category, ())) for split in SPLITS[1:]}
