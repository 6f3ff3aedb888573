"""The isosurface of an object's density as triangles.

The density is evaluated on a grid, slab by slab and only in cells that may be occupied, so memory is bounded by a slab.
Marching cubes turns slabs into triangles, which are welded at shared planes. A corner is evaluated once, so two slabs
agree on their shared plane and every edge has two triangles.
"""

import math
from collections.abc import Generator
from functools import partial

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from torch import Tensor

from core.export.triangle_mesh import face_normals
from core.models.model import Instance, Model
from core.rendering.folded_field import FoldedField
from core.rendering.occupancy import Occupancy, shape_occupancy
from core.runtime.pool import map_pieces
from core.streams import subprogress

MAX_RESOLUTION = 1024  # cells along the longest side; a cell is then a thousandth of the object
RESOLUTIONS = (96, 128, 192, 256, 384)
"""cells along the longest side, tried in turn by default; the first serves for comparison only"""
TOLERANCE = 0.001
"""scene units: largest distance of an automatic mesh from the true surface, up to :data:`_MAX_OFF_SURFACE`"""
_MAX_OFF_SURFACE = 1 / 30  # fraction of the surface's area that may lie further away, or may be missing
_PROBES = 4096  # points of the surface at which the distance is checked
_INTERVALS = 64
"""Along the longest side of the box in training. The isosurface has the density that absorbs half of the light within
one interval; a lower one would show a fringe that no image shows.
"""
_LOGIT_CLAMP = 8.0  # bound of logits, so that one outlier does not displace the surface
_LEAST_LOGIT = 0.01  # added to the size of logits: a corner is off the surface by at least a thousandth of a cell
_MIN_PIECE = 0.05  # scene units (an object's diagonal is 1): pieces with a smaller bounding box diagonal are dropped
_SLAB = 8  # planes of the grid that a thread evaluates at a time
_BLOCK = 4096  # points that a thread evaluates at a time, so that activations stay in cache


def interval_of(model: Model) -> float:
    """Return the length of an interval in training, scene units."""
    return 2 * max(model.extent) / _INTERVALS


def extract_surface(
    instance: Instance, folded: FoldedField, resolution: int | None = None
) -> Generator[float, None, tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "faces 3"]]]:
    """Return vertices (scene units) and triangles of the surface; yields the fraction done.

    Drops pieces smaller than a twentieth of the object's diagonal, and walls of cavities that are invisible from
    outside. Raises ``ValueError`` for a resolution out of range, or if there is no surface.

    Args:
        resolution: cells along the longest side of the model's box; None: the first of :data:`RESOLUTIONS` whose area
            has stopped growing and whose surface lies within :data:`TOLERANCE`, else the last.
    """
    if resolution is not None and not 8 <= resolution <= MAX_RESOLUTION:
        raise ValueError(f"a mesh has a resolution of 8 to {MAX_RESOLUTION}, got {resolution}")
    occupancy = shape_occupancy(instance)
    area = 0.0
    surface: tuple[np.ndarray, np.ndarray] | None = None
    tries = (resolution,) if resolution else RESOLUTIONS
    for index, cells in enumerate(tries):
        grid = _Grid(instance.model, cells)
        begin, end = (number / len(tries) for number in (index, index + 1))
        surface = yield from subprogress(_marching_cubes(folded, occupancy, grid), begin, end)
        if surface is None:
            continue
        vertices, faces = surface
        triangle_normals = face_normals(vertices, faces)
        coarser_area = area
        area = float(np.linalg.norm(triangle_normals, axis=1).sum())
        # Parts thinner than a cell are missing and add to the area once a finer grid finds them.
        if (
            area < (1 + _MAX_OFF_SURFACE) * coarser_area
            and _off_surface_fraction(folded, grid, vertices, faces, triangle_normals) < _MAX_OFF_SURFACE
        ):
            break
    if surface is None:
        raise ValueError("the object has no surface: its density is too low everywhere")
    return surface


class _Grid:
    """Corners over the model's box, with a layer of empty corners around it that closes every surface.

    Args:
        resolution: cells along the longest side of the box.
    """

    def __init__(self, model: Model, resolution: int) -> None:
        self.half = np.array(model.extent)
        cells = np.ceil(resolution * self.half / self.half.max() - 1e-9).astype(int)
        self.counts = (cells + 3).tolist()  # corners along x, y, z, including the empty ones
        self.step = 2 * self.half / cells  # scene units from one corner to the next
        self.interval = interval_of(model)  # scene units

    def points(self, first: int, last: int) -> Float[Tensor, "planes y z 3"]:
        """Return corners of planes ``first`` to ``last`` (exclusive) without the empty ones at the other sides."""
        ranges = (np.arange(first, last), *(np.arange(1, count - 1) for count in self.counts[1:]))
        axes = [(r - 1) * s - h for r, s, h in zip(ranges, self.step, self.half, strict=True)]
        return torch.stack(torch.meshgrid(*(torch.from_numpy(axis).float() for axis in axes), indexing="ij"), -1)


def _marching_cubes(
    folded: FoldedField, occupancy: Occupancy, grid: _Grid
) -> Generator[float, None, tuple[np.ndarray, np.ndarray] | None]:
    """Return vertices (scene units) and triangles of the surface on a grid; None if it does not meet the grid."""
    from skimage.measure import marching_cubes  # takes as long to import as half of torch

    pieces = []  # vertices (in grid steps) and triangles of every slab that is not empty
    count = grid.counts[0]
    starts = range(0, count, _SLAB)
    planes = map_pieces(partial(_logits, folded, occupancy, grid), starts)
    border = np.empty((0, *grid.counts[1:]), np.float32)  # evaluated once: two evaluations may differ in the last bit
    for first, plane in zip(starts, planes, strict=True):
        logits = np.concatenate((border, plane))
        if logits.max() > 0:
            vertices, faces, _, _ = marching_cubes(logits, 0.0, gradient_direction="ascent")
            pieces.append((vertices.astype(np.float64) + np.array([first - len(border), 0, 0]), faces))
        border = plane[-1:]
        yield min(first + _SLAB, count) / count
    if not pieces:
        return None
    vertices, faces = _remove_specks(*_weld(pieces), grid.step)
    return ((vertices - 1) * grid.step - grid.half).astype(np.float32), faces


def _off_surface_fraction(
    folded: FoldedField, grid: _Grid, vertices: np.ndarray, faces: np.ndarray, triangle_normals: np.ndarray
) -> float:
    """Return the fraction of the area that lies further than :data:`TOLERANCE` from the true surface."""
    areas = np.linalg.norm(triangle_normals, axis=1)
    probed = np.searchsorted(areas.cumsum(), (np.arange(_PROBES) + 0.5) / _PROBES * areas.sum())
    middles = vertices[faces[probed]].mean(1)
    outward = triangle_normals[probed] / areas[probed, None]
    sides = torch.from_numpy(np.concatenate((middles - TOLERANCE * outward, middles + TOLERANCE * outward))).float()
    below, above = (_thickness(folded, grid, sides.to(folded.device)).cpu() > math.log(2)).chunk(2)
    return 1 - float((below & ~above).float().mean())


@torch.inference_mode()
def _thickness(folded: FoldedField, grid: _Grid, points: Float[Tensor, "points 3"]) -> Float[Tensor, "points"]:
    """The optical depth of an interval at these points."""
    return folded.density(points)[0] * grid.interval


def _logits(folded: FoldedField, occupancy: Occupancy, grid: _Grid, first: int) -> Float[np.ndarray, "planes y z"]:
    """Return the logits of a slab's planes, positive inside: the logit of the opacity of one interval.

    Densities jump by orders of magnitude between two corners; their logits are nearly linear, so the surface is smooth.
    """
    end = min(first + _SLAB, grid.counts[0])
    inner_first = max(first, 1)
    inner_end = min(end, grid.counts[0] - 1)
    logits = np.full((end - first, *grid.counts[1:]), -_LOGIT_CLAMP, np.float32)
    if inner_first >= inner_end:  # the last slab is the empty layer alone
        return logits
    points = grid.points(inner_first, inner_end).to(occupancy.extent.device)
    within = occupancy.contains(points)
    thickness = torch.cat([_thickness(folded, grid, block) for block in points[within].split(_BLOCK)])
    values = thickness.expm1().clamp_min(1e-9).log().clamp(-_LOGIT_CLAMP, _LOGIT_CLAMP)
    # A corner exactly on the surface would produce empty triangles; a bound of the size would make equal corners, and
    # marching cubes joins four triangles at an edge where opposite corners of a face have equal products.
    values = torch.where(values < 0, values - _LEAST_LOGIT, values + _LEAST_LOGIT)
    inner = np.full(within.shape, -_LOGIT_CLAMP, np.float32)
    inner[within.cpu().numpy()] = values.cpu().numpy()
    logits[inner_first - first : inner_end - first, 1:-1, 1:-1] = inner
    return logits


def _weld(pieces: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Join slabs to one surface; slabs have bitwise equal vertices on shared planes, the last of each slab."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in pieces])
    vertices = np.concatenate([vertices for vertices, _ in pieces])
    faces = np.concatenate([faces + start for (_, faces), start in zip(pieces, starts[:-1], strict=True)])
    on_plane = np.flatnonzero(vertices[:, 0] % _SLAB == _SLAB - 1)
    _, first_index, same = np.unique(vertices[on_plane], axis=0, return_index=True, return_inverse=True)
    target = np.arange(len(vertices))
    target[on_plane] = on_plane[first_index[same.ravel()]]
    return vertices, target[faces]


def _remove_specks(vertices: np.ndarray, faces: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Remove specks, walls of cavities and unused vertices; the largest piece always stays."""
    edges = np.concatenate((faces[:, :2], faces[:, 1:]))
    graph = coo_array((np.ones(len(edges), bool), edges.T), shape=(len(vertices), len(vertices)))
    count, piece = connected_components(graph, directed=False)
    low = np.full((count, 3), np.inf)
    high = np.full((count, 3), -np.inf)
    np.minimum.at(low, piece, vertices * step)
    np.maximum.at(high, piece, vertices * step)
    size = np.linalg.norm(high - low, axis=1)
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    volume = np.bincount(piece[faces[:, 0]], (np.cross(a, b) * c).sum(1), count)
    size[volume <= 0] = -1.0  # the wall of a cavity faces inward
    large = size >= min(_MIN_PIECE, size.max())
    faces = faces[large[piece[faces[:, 0]]]]
    used, renamed = np.unique(faces, return_inverse=True)
    return vertices[used], renamed.reshape(-1, 3)
