"""The gallery of a model: the few of its training objects that its file keeps, chosen for variety.

A fit needs the statistics of all codes, and prototypes from all over the shapes; a person browsing wants no near
doubles and no broken objects. The codes of thousands of objects serve neither.
"""

from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from core.lab.datasets.srn import Dataset
from core.metrics import psnr
from core.models.codes import CodeBook, farthest_first
from core.models.model import Model
from core.rendering.images import render_image

GALLERY_SIZE = 150
"""More than the view bank has prototypes."""
_REJECTED = 0.25
"""The fraction of objects, those rendered worst, that a gallery leaves out."""
_TEXTURE_WEIGHT = 0.3
"""of a distance between textures beside one between shapes, both in standard deviations"""


def training_psnr(model: Model, dataset: Dataset) -> dict[str, float]:
    """PSNR (dB) of every training object's last view of a dataset, by name."""
    index, found = model.codes.index, dict[str, float]()
    for views in dataset.objects:
        if views.name in index:
            colour = render_image(model, model.codes[index[views.name]], views.cameras[-1]).colour.clamp(0, 1).cpu()
            found[views.name] = psnr(colour, torch.from_numpy(views.images[-1]).float() / 255)
    return found


def select_gallery(book: CodeBook, scores: Mapping[str, float], count: int = GALLERY_SIZE) -> tuple[int, ...]:
    """The objects of a gallery, each unlike all before it, beginning with the most ordinary one.

    Args:
        scores: dB by object name; the worst quarter is left out, as are objects without a score.
        count: at most so many.

    Raises ``ValueError`` where no object has a score.
    """
    scored = [index for index in book.valid if book.objects[index].name in scores]
    if not scored:
        raise ValueError("the dataset has none of the model's objects")
    scored.sort(key=lambda index: scores[book.objects[index].name])
    good = sorted(scored[int(_REJECTED * len(scored)) :])
    places = _coordinates(book, good)
    middle = int(places.square().sum(1).argmin())
    return tuple(good[one] for one in farthest_first(places, count, middle))


def _coordinates(book: CodeBook, objects: Sequence[int]) -> Float[Tensor, "objects numbers"]:
    """Where objects lie: their codes from the mean, so that strong directions count most, per standard deviation."""
    entries = [book.objects[index] for index in objects]
    shapes, textures = book.shapes[[one.shape for one in entries]], book.textures[[one.texture for one in entries]]
    parts = ((book.shape_space, shapes, 1.0), (book.texture_space, textures, _TEXTURE_WEIGHT))
    return torch.cat([w * (codes - space.mean) / space.std.square().sum().sqrt() for space, codes, w in parts], 1)
