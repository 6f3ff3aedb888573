"""The categories that datasets are rendered of, and what their objects are for."""

from typing import Literal, get_args

SRN_DISTANCES = {"cars": 1.3, "chairs": 2.0}
"""Scene units from SRN's cameras to the origin, by category; chairs are taller, so SRN steps back to hold them in the
image."""

Split = Literal["train", "validation", "test"]
SPLITS: tuple[Split, ...] = get_args(Split)
