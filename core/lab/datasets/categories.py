"""Categories of datasets: their sizes, and the splits of their objects."""

from typing import Literal, NamedTuple, get_args


class Sizes(NamedTuple):
    """Of a category; models that are trained on its datasets know them from then on."""

    distance: float  # scene units from cameras to the origin
    metres: float  # the longest side of a usual object


_SIZES = {"cars": Sizes(1.3, 4.5), "chairs": Sizes(2.0, 0.9)}
"""Distances as in ShapeNet-SRN: chairs are taller, so its cameras step back to hold them in the image."""
_OTHER = Sizes(1.8, 1.0)  # A sphere of diameter 1 fills half of the image's width.

Split = Literal["train", "validation", "test"]
SPLITS: tuple[Split, ...] = get_args(Split)


def category_sizes(category: str) -> Sizes:
    """The sizes of a category; a category of which nothing is known has usual ones."""
    return _SIZES.get(category, _OTHER)
