"""Label the triangles of a mesh by part: wheels, glass and body, or seat, back, legs and arms.

A linear classifier of the density's features (:class:`core.models.part_head.PartHead`) predicts the part of each
triangle. Predictions are averaged over neighbours, rules exclude impossible places, and small patches join the part
around them.
"""

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.export.triangle_mesh import MeshParts, face_normals
from core.models.model import Model
from core.models.part_head import ABOVE_SEAT, PartHead
from core.rendering.folded_field import FoldedField
from core.runtime.pool import map_pieces

Pairs = Int[np.ndarray, "2 pairs"]  # triangles that share an edge
_DEPTH = 0.004  # scene units below the surface, where the classifier is most reliable
_TRIANGLES_PER_PASS, _MOST_PASSES = 2500, 60
"""passes over a mesh, so that averaging reaches equally far in coarse and fine ones; limit for very fine ones"""
_TEETH = 4  # passes that straighten borders; limited because two triangles may swap parts for ever
_PATCH = 0.01  # of the surface; smaller patches are not a part
_BLOCK = 4096  # points that a thread evaluates at a time
_WHEELS_END, _WHEELS_BEGIN, _GLASS_BEGINS, _GLASS_ENDS = 0.6, 0.15, 0.38, 0.6
"""fractions of a car's height: wheels lie below the first and begin below the second; glass lies above the third and
reaches the fourth, which a dark bumper does not
"""
_BUMPER, _BETWEEN_WHEELS = 0.03, 0.4  # without wheels: of a car's length at either end; of its width, amid


def by_part(
    model: Model, folded: FoldedField, vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> tuple[Int[np.ndarray, "faces 3"], MeshParts]:
    """Sort triangles by part and count each part's; a single part if the model has no part head."""
    if not model.part_head:
        return faces, ((model.noun or "object", len(faces)),)
    labels = _label_faces(model.part_head, folded, vertices, faces)
    names = model.part_head.names
    counts = np.bincount(labels, minlength=len(names)).tolist()
    return faces[np.argsort(labels, kind="stable")], tuple((n, c) for n, c in zip(names, counts, strict=True) if c)


def _label_faces(
    head: PartHead, folded: FoldedField, vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Int[np.ndarray, "faces"]:
    """Return each triangle's part as an index into the head's names."""
    normals = face_normals(vertices, faces)
    area = np.linalg.norm(normals, axis=1)
    middles = vertices[faces].mean(1)
    inside = middles - _DEPTH * normals / np.maximum(area[:, None], 1e-12)
    probability = _probability(head, folded, inside)
    middles, ends = (folded.origins(torch.from_numpy(points).float()).numpy() for points in (middles, vertices))
    low = ends.min(0)
    fractions = (middles - low) / (ends.max(0) - low)
    above = np.zeros(len(faces))
    if "seat" in head.names:
        facing_up = probability[:, head.names.index("seat")] * np.maximum(normals[:, 2], 0.0)
        above = middles[:, 2] - _weighted_median(middles[:, 2], facing_up)
    probability = np.maximum(probability, 1e-6)  # excluded parts rank below unlikely ones
    for index, name in enumerate(head.names):
        probability[_never(name, fractions, above), index] = 0.0
    pairs = _neighbours(faces)
    labels = _without_teeth(_averaged(probability, pairs, area).argmax(1), pairs)
    return _without_strays(_without_patches(labels, pairs, area), pairs, fractions[:, 2], head.names)


def _probability(
    head: PartHead, folded: FoldedField, points: Float[np.ndarray, "faces 3"]
) -> Float[np.ndarray, "faces parts"]:
    with torch.inference_mode():
        blocks = torch.from_numpy(points).float().to(folded.device).split(_BLOCK)
        probabilities = map_pieces(lambda block: head(folded.density(block)[1]), blocks)
        return torch.cat(list(probabilities)).cpu().numpy()


def _weighted_median(values: Float[np.ndarray, "faces"], weights: Float[np.ndarray, "faces"]) -> float:
    order = np.argsort(values)
    total = weights[order].cumsum()
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


def _never(
    name: str, fractions: Float[np.ndarray, "faces 3"], above: Float[np.ndarray, "faces"]
) -> Bool[np.ndarray, "faces"]:
    """Mark triangles that cannot be this part, by position in the bounding box (0..1) and height above the seat."""
    x, y = np.abs(fractions[:, :2] - 0.5).T
    z = fractions[:, 2]
    if name == "wheels":
        return (z > _WHEELS_END) | (y > 0.5 - _BUMPER) | (x < 0.5 * _BETWEEN_WHEELS)
    if name == "glass":
        return z < _GLASS_BEGINS
    low, high = ABOVE_SEAT.get(name, (-np.inf, np.inf))
    return (above < low) | (above > high)


def _neighbours(faces: Int[np.ndarray, "faces 3"]) -> Pairs:
    edges = np.sort(np.concatenate((faces[:, :2], faces[:, 1:], faces[:, ::2])), axis=1)
    owner = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort(edges.T)
    same = (np.diff(edges[order], axis=0) == 0).all(1)
    return np.stack((owner[order][:-1][same], owner[order][1:][same]))


def _averaged(
    probability: Float[np.ndarray, "faces parts"], pairs: Pairs, area: Float[np.ndarray, "faces"]
) -> Float[np.ndarray, "faces parts"]:
    """Average repeatedly over each triangle and its neighbours, weighted by area."""
    count = len(area)
    itself = np.arange(count)
    target, source = np.concatenate((pairs, pairs[::-1], (itself, itself)), axis=1)
    weights = coo_array((area[source], (target, source)), shape=(count, count)).tocsr()
    total = np.maximum(weights @ np.ones((count, 1)), 1e-12)
    for _ in range(min(_MOST_PASSES, -(-count // _TRIANGLES_PER_PASS))):
        probability = weights @ probability / total
    return probability


def _without_teeth(labels: Int[np.ndarray, "faces"], pairs: Pairs) -> Int[np.ndarray, "faces"]:
    """Straighten borders: a triangle joins the part of at least two of its three neighbours."""
    a, b = np.concatenate((pairs, pairs[::-1]), axis=1)
    for _ in range(_TEETH):
        votes = np.zeros((len(labels), int(labels.max()) + 1))
        np.add.at(votes, (a, labels[b]), 1)
        labels = np.where(votes.max(1) >= 2, votes.argmax(1), labels)
    return labels


def _patches(labels: Int[np.ndarray, "faces"], pairs: Pairs) -> tuple[int, Int[np.ndarray, "faces"]]:
    """Return the number of connected patches of one part, and each triangle's patch."""
    within = pairs[:, labels[pairs[0]] == labels[pairs[1]]]
    graph = coo_array((np.ones(within.shape[1], bool), within), shape=(len(labels), len(labels)))
    return connected_components(graph, directed=False)


def _without_patches(
    labels: Int[np.ndarray, "faces"], pairs: Pairs, area: Float[np.ndarray, "faces"]
) -> Int[np.ndarray, "faces"]:
    """Merge small patches into the part of most of their larger neighbours, until none is left."""
    a, b = np.concatenate((pairs, pairs[::-1]), axis=1)
    while True:
        count, patch = _patches(labels, pairs)
        size = np.bincount(patch, area, count)
        border = (size[patch[a]] < min(_PATCH * area.sum(), size.max())) & (size[patch[b]] > size[patch[a]])
        border &= labels[a] != labels[b]
        if not border.any():
            return labels
        votes = np.zeros((count, int(labels.max()) + 1))
        np.add.at(votes, (patch[a[border]], labels[b[border]]), 1)
        labels = np.where(votes.max(1)[patch] > 0, votes.argmax(1)[patch], labels)


def _without_strays(
    labels: Int[np.ndarray, "faces"], pairs: Pairs, height: Float[np.ndarray, "faces"], names: tuple[str, ...]
) -> Int[np.ndarray, "faces"]:
    """Relabel wheels that begin too high and glass that ends too low as the first part."""
    count, patch = _patches(labels, pairs)
    low = np.ones(count)
    high = np.zeros(count)
    np.minimum.at(low, patch, height)
    np.maximum.at(high, patch, height)
    stray: dict[str, np.ndarray] = {"wheels": low > _WHEELS_BEGIN, "glass": high < _GLASS_ENDS}
    for index, name in enumerate(names):
        if name in stray:
            labels = np.where((labels == index) & stray[name][patch], 0, labels)
    return labels
