"""Whether shape and texture are told apart: pairs of codes that were never trained together, and what leaks.

A factorial dataset says in its manifest which objects share a shape and which a texture. Objects that the model knows
by name give the codes; an object it does not know, but whose shape and texture two of those have, is a held-out cell.
"""

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from core.datasets.srn import ObjectEntry, ObjectViews
from core.evaluation.protocol import Mean, compared, drawn_view, fitted, mean_of, photo
from core.fitting.fit import FitJob
from core.models.codes import Codes
from core.models.model import Model
from core.rendering.fast import render
from core.rendering.reference import Rendered, render_exact

_VIEWS = 12
"""of a cell are drawn, spread over all"""
_FITTED_VIEWS = 6
"""of a cell, others than the drawn ones where it has more, with their cameras"""
_GROUND = 1e-3
"""A pixel that is less opaque than this shows the ground."""
_EDIT_SAMPLES = 96


@dataclass(frozen=True)
class Cell:
    """An object of the table of shapes and textures, and the rows of the code book that stand for it."""

    place: ObjectEntry
    shape: int
    texture: int
    trained: bool
    """as this pair"""


@dataclass(frozen=True, eq=False)
class CellScore:
    """A cell drawn with the codes of its shape and its texture."""

    cell: Cell
    psnr: float
    """dB"""
    ssim: float
    direct: tuple[float, float] | None
    """PSNR in dB and SSIM of the same views, drawn with :attr:`fitted`"""
    opacity_change: float
    """0..1, the largest at any pixel when it wears another cell's texture"""
    ground_change: float
    """0..1, the largest of a colour beside the object"""
    fitted: Codes | None
    """found from pictures of the cell alone; None for entangled architectures, which are not fitted"""
    pictures: UInt8[np.ndarray, "height two_widths 3"]
    """the true view and the drawn one"""


def table(model: Model, places: Sequence[ObjectEntry]) -> tuple[Cell, ...]:
    """The cells that the model has codes for. Raises ``ValueError`` where none of them is held out.

    Broken objects lend no codes.
    """
    book = model.codes
    known = {book.objects[index].name: book.objects[index] for index in book.valid}
    trained = [place for place in places if place.name in known]
    shapes = {place.shape_id: known[place.name].shape for place in trained}
    textures = {place.texture_id: known[place.name].texture for place in trained}
    cells = tuple(
        Cell(place, shapes[place.shape_id], textures[place.texture_id], place.name in known)
        for place in places
        if place.shape_id in shapes and place.texture_id in textures
    )
    if all(cell.trained for cell in cells):
        raise ValueError(
            f"no held-out cell: the model knows {len(trained)} of the {len(places)} objects by name, and no other "
            "object has the shape of one of these and the texture of another"
        )
    return cells


def swap(model: Model, cells: Sequence[Cell], seed: int = 0) -> Iterator[CellScore]:
    """A score per cell, in their order. To stop, ask for no more."""
    for index, cell in enumerate(cells):
        yield _scored(model, cell, cells[index - 1].texture, seed)


def _scored(model: Model, cell: Cell, other_texture: int, seed: int) -> CellScore:
    views, book = cell.place.read(), model.codes
    codes = Codes(book.shapes[cell.shape], book.textures[cell.texture])
    every = range(len(views.cameras))
    drawn = _spread(every, _VIEWS)
    found = (
        None
        if model.is_ablation
        else _fitted(model, views, [view for view in every if view not in drawn] or drawn, seed)
    )
    edited = Codes(codes.shape, book.textures[other_texture])
    before, after = (_seen(model, worn, views) for worn in (codes, edited))
    ground = before.opacity < _GROUND
    change = (before.colour - after.colour).abs().amax(-1)[ground]
    picture = (drawn_view(model, codes, views.cameras[0]).numpy() * 255 + 0.5).astype(np.uint8)
    return CellScore(
        cell,
        *_compared(model, codes, views, drawn),
        None if found is None else _compared(model, found, views, drawn),
        float((before.opacity - after.opacity).abs().max()),
        float(change.max()) if len(change) else 0.0,
        found,
        np.hstack((views.images[0], picture)),
    )


def _compared(model: Model, codes: Codes, views: ObjectViews, drawn: Sequence[int]) -> tuple[float, float]:
    psnr, ssim = np.mean([compared(model, codes, views, index) for index in drawn], axis=0)
    return float(psnr), float(ssim)


def _fitted(model: Model, views: ObjectViews, among: Sequence[int], seed: int) -> Codes:
    photos = tuple(photo(views, index, True) for index in _spread(among, _FITTED_VIEWS))
    return fitted(model, FitJob(photos, seed=seed))[1].codes


def _spread(views: Sequence[int], most: int) -> list[int]:
    count = min(most, len(views))
    return [views[index * len(views) // count] for index in range(count)]


def _seen(model: Model, codes: Codes, views: ObjectViews) -> Rendered:
    """The first view with its opacity."""
    camera = views.cameras[0]
    if model.white_from_network or model.is_ablation:
        return render_exact(model, codes, camera, _EDIT_SAMPLES)
    return render(model, codes, camera, _EDIT_SAMPLES)


# Leaks


@dataclass(frozen=True)
class Probe:
    """How often a classifier reads an identity from codes."""

    accuracy: Mean
    """share of cells, 0..1"""
    chance: float
    cells: int
    """that could be asked"""


def probe(codes: Float[Tensor, "cells latent"], labels: Sequence[Hashable], groups: Sequence[Hashable]) -> Probe | None:
    """A classifier by the nearest centroid, shown only cells of other groups than the one asked; None where no label
    has a cell in another group.

    Asked for the texture, cells of the same shape are a group: what a shape looks like in its other textures would
    otherwise tell against the right one. Chance is one in as many labels as could be answered.
    """
    hits, chances = [], []
    for index, (label, group) in enumerate(zip(labels, groups, strict=True)):
        members: dict[Hashable, list[int]] = {}
        for other, (name, kind) in enumerate(zip(labels, groups, strict=True)):
            if kind != group:
                members.setdefault(name, []).append(other)
        if label in members and len(members) > 1:
            names = list(members)
            centroids = torch.stack([codes[members[name]].mean(0) for name in names])
            hits.append(float(names[int((centroids - codes[index]).norm(dim=1).argmin())] == label))
            chances.append(1 / len(names))
    return Probe(mean_of(hits), float(np.mean(chances)), len(hits)) if hits else None


@dataclass(frozen=True)
class SwapSummary:
    """What the cells say together."""

    swapped: Mean
    """PSNR in dB, of held-out cells"""
    swapped_ssim: Mean
    swapped_cells: int
    direct: Mean
    """of the same cells and views, with codes fitted to other pictures of each cell; NaN for entangled architectures"""
    direct_ssim: Mean
    trained: Mean
    """of trained cells; flattered where their views were trained on"""
    trained_ssim: Mean
    trained_cells: int
    opacity_change: float
    ground_change: float
    probes: dict[str, Probe | None]
    """empty for entangled architectures"""


def swap_summary(scores: Sequence[CellScore]) -> SwapSummary:
    """Means, the largest changes, and the four probes on the fitted codes."""
    held, own = ([score for score in scores if score.cell.trained == trained] for trained in (False, True))
    fits = [score.direct for score in held if score.direct]
    opacity, ground = (max(getattr(score, name) for score in scores) for name in ("opacity_change", "ground_change"))
    return SwapSummary(
        swapped=mean_of([score.psnr for score in held]),
        swapped_ssim=mean_of([score.ssim for score in held]),
        swapped_cells=len(held),
        direct=mean_of([psnr for psnr, _ in fits]),
        direct_ssim=mean_of([ssim for _, ssim in fits]),
        trained=mean_of([score.psnr for score in own]),
        trained_ssim=mean_of([score.ssim for score in own]),
        trained_cells=len(own),
        opacity_change=opacity,
        ground_change=ground,
        probes=_probes(scores),
    )


def _probes(scores: Sequence[CellScore]) -> dict[str, Probe | None]:
    fits = [score.fitted for score in scores if score.fitted is not None]
    if len(fits) < len(scores):
        return {}
    shapes = [score.cell.place.shape_id for score in scores]
    textures = [score.cell.place.texture_id for score in scores]
    codes = {kind: torch.stack([getattr(fit, kind) for fit in fits]) for kind in ("shape", "texture")}
    return {
        f"{what} from {kind} codes": probe(codes[kind], *asked)
        for what, asked in (("texture", (textures, shapes)), ("shape", (shapes, textures)))
        for kind in ("shape", "texture")
    }
