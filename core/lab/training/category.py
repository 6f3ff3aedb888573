"""Training :mod:`core.classifiers.category`: crops of objects of each category against shapes that are none of them."""

import math
from collections.abc import Iterator, Sequence

import torch
from jaxtyping import Float, UInt8
from torch import Tensor
from torch.nn import functional

from core.classifiers.category import CategoryClassifier
from core.classifiers.crops import SIDE
from core.lab.training.augmentation import Crops, augment_photo, on_white, recrop, resample, some
from core.lab.training.viewpoint import BATCH_SIZE, ViewpointDataset, train_classifier

_LABEL_SMOOTHING = 0.02
"""avoids over-confidence"""
_LOW = math.radians(35)
"""rad; elevation up to which an object turned on its side is no view of it any more"""
_MAX_PARTS = 6
"""of a random shape"""
_Distractors = Float[Tensor, "distractors 4 side side"]


def train_category(
    classifier: CategoryClassifier, datasets: Sequence[ViewpointDataset], steps: int, seed: int = 0
) -> Iterator[float]:
    """Train a network in place, yielding the loss of each step; to stop, take no more values.

    Args:
        datasets: images of each of the classifier's categories.
    """
    generator = torch.Generator().manual_seed(seed)
    share = BATCH_SIZE // (len(datasets) + 1)
    labels = torch.arange(len(datasets) + 1).repeat_interleave(share)

    def batch_loss() -> Tensor:
        rows = [torch.randint(len(part.images), (share,), generator=generator) for part in datasets]
        images = torch.cat([part.images[row] for part, row in zip(datasets, rows, strict=True)]).float() / 255
        low = torch.cat([part.elevation[row] for part, row in zip(datasets, rows, strict=True)]).abs() < _LOW
        images = torch.cat((images, random_distractors(images[low], share, generator)))
        images, _ = augment_photo(images, torch.zeros(len(images)), generator)
        return functional.cross_entropy(classifier(images), labels, label_smoothing=_LABEL_SMOOTHING)

    yield from train_classifier(classifier, batch_loss, steps)


def random_distractors(images: Crops, count: int, generator: torch.Generator) -> _Distractors:
    """Images of nothing that a model knows: unions of random solids, blobs, and real objects turned by a quarter or
    more, zoomed into, or pasted together from two.

    Args:
        images: of real objects, none from above: there, an object that is turned is one from another side.
    """
    kinds = (_random_parts, _random_blobs, _turned, _details, _pasted)
    made = [kind(images, -(-count // len(kinds)), generator) for kind in kinds]
    return recrop(torch.cat(made)[torch.randperm(len(made) * len(made[0]), generator=generator)[:count]])


def _random_parts(_: Crops, count: int, generator: torch.Generator) -> _Distractors:
    """Unions of ellipses and rectangles, each of a colour: people, bottles, houses and lamps at this size."""
    axis = torch.linspace(-1, 1, SIDE)
    colours, mask = torch.ones(count, 3, SIDE, SIDE), torch.zeros(count, 1, SIDE, SIDE)
    for part in range(_MAX_PARTS):
        place, size, tone = (torch.rand(count, n, 1, 1, generator=generator) for n in (2, 2, 3))
        angle = math.pi * torch.rand(count, 1, 1, generator=generator)
        x = axis[None, None, :] - (1.4 * place[:, 0] - 0.7)
        y = axis[None, :, None] - (1.4 * place[:, 1] - 0.7)
        along = (x * angle.cos() + y * angle.sin()) / (0.05 + 0.65 * size[:, 0] ** 2)
        across = (y * angle.cos() - x * angle.sin()) / (0.05 + 0.65 * size[:, 1])
        power = torch.where(some(count, 0.5, generator)[:, None, None], 2.0, 12.0)
        inside = (along.abs() ** power + across.abs() ** power < 1)[:, None]
        inside = inside & some(count, 0.7 if part else 1.0, generator)[:, None, None, None]
        colours = torch.where(inside, tone, colours)
        mask = torch.where(inside, 1.0, mask)
    return on_white(colours, mask)


def _random_blobs(_: Crops, count: int, generator: torch.Generator) -> _Distractors:
    """Smooth noise above a threshold, in smooth colours: animals, plants, rocks and cut-outs that failed."""
    coarse = int(torch.randint(3, 9, (1,), generator=generator))
    noise = functional.interpolate(
        torch.randn(count, 4, coarse, coarse, generator=generator), SIDE, mode="bicubic", align_corners=False
    )
    axis = torch.linspace(-1, 1, SIDE)
    middle = 1.2 - 1.6 * (axis**2 + axis[:, None] ** 2)
    mask = (noise[:, 3:] + middle > 0).float()
    mask = torch.where(mask.sum((1, 2, 3), keepdim=True) > 0, mask, torch.ones(1))
    return on_white((0.5 + 0.3 * noise[:, :3]).clamp(0, 1), mask)


def _turned(images: Crops, count: int, generator: torch.Generator) -> _Distractors:
    """Objects on their sides or heads."""
    chosen = images[torch.randint(len(images), (count,), generator=generator)]
    turns = torch.randint(1, 4, (count,), generator=generator).tolist()
    return torch.stack([one.rot90(turn, (1, 2)) for one, turn in zip(chosen, turns, strict=True)])


def _details(images: Crops, count: int, generator: torch.Generator) -> _Distractors:
    """Small parts of objects, filling the image."""
    affine = torch.zeros(count, 2, 3)
    affine[:, 0, 0] = affine[:, 1, 1] = 0.15 + 0.15 * torch.rand(count, generator=generator)
    affine[:, :, 2] = torch.rand(count, 2, generator=generator) - 0.5
    found = resample(images[torch.randint(len(images), (count,), generator=generator)], affine)
    empty = found[:, 3:].sum((1, 2, 3), keepdim=True) < 1
    return torch.where(empty, torch.cat((found[:, :3], torch.ones_like(found[:, 3:])), 1), found)


def _pasted(images: Crops, count: int, generator: torch.Generator) -> _Distractors:
    """The left half of one image beside the upper part of another."""
    one, other = (images[torch.randint(len(images), (count,), generator=generator)] for _ in range(2))
    left = (torch.arange(SIDE) < SIDE // 2)[None, None, None, :]
    return torch.where(left, one.roll(SIDE // 3, 2), other.flip(2).roll(-SIDE // 4, 3))


def category_accuracy(
    classifier: CategoryClassifier, crops: UInt8[Tensor, "images 4 side side"], label: int
) -> Float[Tensor, ""]:
    """The fraction of crops of one class that are recognised, 0..1."""
    with torch.no_grad():
        return (classifier(crops.float() / 255).argmax(1) == label).float().mean()
