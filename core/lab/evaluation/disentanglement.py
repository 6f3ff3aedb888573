"""Disentanglement of shape and texture: codes recombined in untrained pairs, and information leaks.

The manifest of a factorial dataset says which objects share a shape or a texture. The model's training objects, matched
by name, provide the codes. Any other object whose shape and texture both occur among them is a held-out pair.
"""

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from core.fitting.fit import FitJob
from core.geometry.pixels import to_bytes
from core.lab.datasets.splits import evenly_spaced
from core.lab.datasets.srn import ObjectEntry, ObjectViews
from core.lab.evaluation.protocol import as_photo, fit_first_last, score_view
from core.lab.evaluation.statistics import Mean, mean_of
from core.models.codes import Codes
from core.models.model import Instance, Model
from core.rendering.images import render_image

_RENDERED_VIEWS = 12  # of a pair, evenly spaced
_FITTED_VIEWS = 6  # of a pair, with their cameras; disjoint from the rendered ones if possible
_BACKGROUND_OPACITY = 1e-3  # pixels less opaque than this are background
_EDIT_SAMPLES = 96


@dataclass(frozen=True)
class ShapeTexturePair:
    """A combination of a shape and a texture with their rows in the code book."""

    entry: ObjectEntry
    shape: int
    texture: int
    trained: bool  # True if trained as this pair


@dataclass(frozen=True, eq=False)
class PairScore:
    """Quality of a pair's renders with the codes of its shape and its texture."""

    pair: ShapeTexturePair
    psnr: float  # dB
    ssim: float
    refitted: tuple[float, float] | None  # PSNR in dB and SSIM of the same views, rendered with :attr:`fitted_codes`
    opacity_change: float  # 0..1, largest over pixels when the texture code is replaced by another pair's
    background_change: float  # 0..1, largest change of a colour beside the object
    fitted_codes: Codes | None  # fitted to images of the pair alone; None for entangled designs, which fits exclude
    images: UInt8[np.ndarray, "height two_widths 3"]  # the true view and the rendered one


def pairs(model: Model, entries: Sequence[ObjectEntry]) -> tuple[ShapeTexturePair, ...]:
    """Return the pairs that the model has codes for. Raises ``ValueError`` if none of them is held out.

    Excludes codes of collapsed objects.
    """
    book = model.codes
    trained_objects = {book.objects[index].name: book.objects[index] for index in book.valid}
    trained = [entry for entry in entries if entry.name in trained_objects]
    shapes = {entry.shape_id: trained_objects[entry.name].shape for entry in trained}
    textures = {entry.texture_id: trained_objects[entry.name].texture for entry in trained}
    candidates = tuple(
        ShapeTexturePair(entry, shapes[entry.shape_id], textures[entry.texture_id], entry.name in trained_objects)
        for entry in entries
        if entry.shape_id in shapes and entry.texture_id in textures
    )
    if all(pair.trained for pair in candidates):
        raise ValueError(
            f"no held-out pair: the model was trained on {len(trained)} of the {len(entries)} objects, and no other "
            "object has the shape of one of these and the texture of another"
        )
    return candidates


def score_pairs(model: Model, chosen: Sequence[ShapeTexturePair], seed: int = 0) -> Iterator[PairScore]:
    """Yield a score per pair, in order."""
    for index, pair in enumerate(chosen):
        yield _score_pair(model, pair, chosen[index - 1].texture, seed)


def _score_pair(model: Model, pair: ShapeTexturePair, other_texture: int, seed: int) -> PairScore:
    views = pair.entry.read()
    book = model.codes
    instance = Instance(model, Codes(book.shapes[pair.shape], book.textures[pair.texture]))
    indices = range(len(views.cameras))
    rendered = evenly_spaced(indices, _RENDERED_VIEWS)
    rest = [view for view in indices if view not in rendered] or rendered
    fitted = None if model.is_ablation else _fit(model, views, rest, seed)
    edited = Instance(model, Codes(instance.codes.shape, book.textures[other_texture]))
    before, after = (render_image(version, views.cameras[0], _EDIT_SAMPLES) for version in (instance, edited))
    background = before.opacity < _BACKGROUND_OPACITY
    change = (before.colour - after.colour).abs().amax(-1)[background]
    image = to_bytes(render_image(instance, views.cameras[0]).colour)
    return PairScore(
        pair,
        *_mean_score(instance, views, rendered),
        None if fitted is None else _mean_score(fitted, views, rendered),
        float((before.opacity - after.opacity).abs().max()),
        float(change.max()) if len(change) else 0.0,
        None if fitted is None else fitted.codes,
        np.hstack((views.images[0], image)),
    )


def _mean_score(instance: Instance, views: ObjectViews, rendered: Sequence[int]) -> tuple[float, float]:
    psnr, ssim = np.mean([score_view(instance, views, index) for index in rendered], axis=0)[:2]
    return float(psnr), float(ssim)


def _fit(model: Model, views: ObjectViews, candidates: Sequence[int], seed: int) -> Instance:
    photos = tuple(as_photo(views, index, True) for index in evenly_spaced(candidates, _FITTED_VIEWS))
    return fit_first_last(model, FitJob(photos, seed=seed))[1].instance.with_detail(None)


# Leaks


@dataclass(frozen=True)
class Probe:
    """Accuracy of a classifier that recovers an identity from codes."""

    accuracy: Mean  # fraction of pairs, 0..1
    chance: float
    pairs: int  # whose label occurs in another group


def probe(codes: Float[Tensor, "pairs latent"], labels: Sequence[Hashable], groups: Sequence[Hashable]) -> Probe | None:
    """Score a nearest-centroid classifier trained on pairs of other groups than the one to be classified.

    To predict the texture, pairs of one shape form a group: otherwise the same shape in other textures would count
    against the right one. Chance is one over the number of predictable labels. None if no label occurs in two groups.
    """
    hits = []
    chances = []
    for index, (label, group) in enumerate(zip(labels, groups, strict=True)):
        members: dict[Hashable, list[int]] = {}
        for member, (name, member_group) in enumerate(zip(labels, groups, strict=True)):
            if member_group != group:
                members.setdefault(name, []).append(member)
        if label in members and len(members) > 1:
            names = list(members)
            centroids = torch.stack([codes[members[name]].mean(0) for name in names])
            hits.append(float(names[int((centroids - codes[index]).norm(dim=1).argmin())] == label))
            chances.append(1 / len(names))
    return Probe(mean_of(hits), float(np.mean(chances)), len(hits)) if hits else None


@dataclass(frozen=True)
class DisentanglementSummary:
    """Means over all pairs."""

    recombined: Mean  # PSNR in dB of held-out pairs, with the codes of two training objects
    recombined_ssim: Mean
    recombined_pairs: int
    refitted: Mean
    """of the same pairs and views, with codes fitted to other images of each pair; NaN for entangled designs"""
    refitted_ssim: Mean
    trained: Mean  # of trained pairs, also from their training views
    trained_ssim: Mean
    trained_pairs: int
    opacity_change: float
    background_change: float
    probes: dict[str, Probe | None]  # empty for entangled architectures


def summarise_pairs(scores: Sequence[PairScore]) -> DisentanglementSummary:
    """Summarise means, largest changes, and four probes of the fitted codes."""
    held, trained = ([score for score in scores if score.pair.trained == trained] for trained in (False, True))
    fits = [score.refitted for score in held if score.refitted]
    opacity, background = (
        max(getattr(score, name) for score in scores) for name in ("opacity_change", "background_change")
    )
    return DisentanglementSummary(
        recombined=mean_of([score.psnr for score in held]),
        recombined_ssim=mean_of([score.ssim for score in held]),
        recombined_pairs=len(held),
        refitted=mean_of([psnr for psnr, _ in fits]),
        refitted_ssim=mean_of([ssim for _, ssim in fits]),
        trained=mean_of([score.psnr for score in trained]),
        trained_ssim=mean_of([score.ssim for score in trained]),
        trained_pairs=len(trained),
        opacity_change=opacity,
        background_change=background,
        probes=_probes(scores),
    )


def _probes(scores: Sequence[PairScore]) -> dict[str, Probe | None]:
    fits = [score.fitted_codes for score in scores if score.fitted_codes is not None]
    if len(fits) < len(scores):
        return {}
    shapes = [score.pair.entry.shape_id for score in scores]
    textures = [score.pair.entry.texture_id for score in scores]
    codes = {kind: torch.stack([getattr(fit, kind) for fit in fits]) for kind in ("shape", "texture")}
    return {
        f"{label} from {kind} codes": probe(codes[kind], *ids)
        for label, ids in (("texture", (textures, shapes)), ("shape", (shapes, textures)))
        for kind in ("shape", "texture")
    }
