"""An object as a coloured triangle mesh: the isosurface of its density.

The density is evaluated on a grid, slab by slab and only in cells that may be occupied, so memory is bounded by a slab.
Marching cubes turns slabs into triangles, which are welded at shared planes. A corner is evaluated once, so two slabs
agree on their shared plane and every edge has two triangles.
"""

import math
from collections.abc import Generator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from torch import Tensor

from core.detail.lookup import DetailMaps
from core.detail.maps import detail_maps
from core.editing.size import size_of
from core.edits.edit import UNIT
from core.export.glb import place_camera
from core.export.mesh_formats import FORMATS, TEXTURED, Mesh
from core.export.normals import face_normals, vertex_normals
from core.export.parts import by_part
from core.export.simplify import simplify
from core.export.texture import TRIANGLES, TexturedMesh, textured
from core.geometry.camera import WORLD_FROM_GLTF, Camera, Factors
from core.models.model import Instance, Model
from core.rendering.compositing import compositing_weights
from core.rendering.folded_field import FoldedField
from core.rendering.occupancy import Occupancy, shape_occupancy
from core.runtime.files import atomic_file
from core.runtime.modes import isolated
from core.runtime.pool import map_pieces
from core.streams import subprogress

MAX_RESOLUTION = 1024  # cells along the longest side; a cell is then a thousandth of the object
RESOLUTIONS = (96, 128, 192, 256, 384)
"""cells along the longest side, tried in turn by default; the first serves for comparison only"""
MIN_TRIANGLES = 100  # too few below to show a chair
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
_COLOUR_SAMPLES = 8  # samples of the short ray that colours a vertex
_MESH_FRACTION = 0.3  # fraction of the time of a textured mesh; the rest is the texture
_GRID_FRACTION = 0.6  # fraction of the time for the grid; the rest is colours


@dataclass(frozen=True)
class MeshSettings:
    """Options of a mesh file. Raises ``ValueError`` for values out of range."""

    resolution: int | None = None
    """cells along the longest side of the model's box; None: as many as the object's detail needs"""
    metres: float | None = None
    """m, the object's longest side, standing on the ground; None: as large as the object was sized, else in scene units
    and centred at the origin"""
    texture: int = 0  # px, approximate width of the colour image (glb only); 0: colours per vertex
    triangles: int = 0  # at most; 0: all of the grid, or TRIANGLES with a texture

    def __post_init__(self) -> None:
        if self.metres is not None and not 0 < self.metres < 1e6:
            raise ValueError(f"an object must be more than 0 m long, got {self.metres:g}")
        if self.texture and not 16 <= self.texture <= 8192:
            raise ValueError(f"a texture has 16 to 8192 px, got {self.texture}")
        if self.triangles and self.triangles < MIN_TRIANGLES:
            raise ValueError(f"a mesh has {MIN_TRIANGLES} triangles or more, got {self.triangles}")


@isolated
def export_mesh(
    instance: Instance, path: Path, settings: MeshSettings | None = None, camera: Camera | None = None
) -> Generator[float, None, None]:
    """Write an object's mesh to ``path``; a .glb also contains the camera.

    Yields the fraction done, 1.0 at the end. The file appears only when it is complete: to cancel, close the generator.
    Raises ``ValueError`` like :func:`extract_mesh`, and for an unknown format, a texture in a format without textures,
    or a path that cannot be written.
    """
    settings = settings or MeshSettings()
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(f"{path.name}: a mesh file must end in {', '.join(FORMATS)}")
    if settings.texture and suffix not in TEXTURED:
        raise ValueError(f"{path.name}: only {', '.join(TEXTURED)} holds a texture")
    with atomic_file(path) as unfinished:
        end = _MESH_FRACTION if settings.texture else 1.0
        most = settings.triangles or (TRIANGLES if settings.texture else 0)
        mesh = yield from subprogress(extract_mesh(instance, settings.resolution, most), 0.0, end)
        detail = yield from subprogress(detail_maps(instance.unstretched), end, end)
        placing = _Placing.of(instance, mesh.vertices, settings.metres)
        if settings.texture:
            image_mesh = yield from subprogress(_textured(instance, mesh, settings.texture, detail), end, 1.0)
            vertices = placing.vertices(image_mesh.vertices) @ WORLD_FROM_GLTF
            normals = placing.normals(image_mesh.normals) @ WORLD_FROM_GLTF
            unfinished.write_bytes(replace(image_mesh, vertices=vertices, normals=normals).glb())
        else:
            colours = _with_detail(mesh.colours, mesh.vertices, mesh.normals, detail)
            vertices = placing.vertices(mesh.vertices)
            normals = placing.normals(mesh.normals)
            replace(mesh, vertices=vertices, normals=normals, colours=colours).save(unfinished)
        if camera and suffix == ".glb":
            unfinished.write_bytes(place_camera(unfinished.read_bytes(), camera, *placing.of_world))
    yield 1.0


class _Placing(NamedTuple):
    """The map from an object's own space to a file's axes: a shift, then a scale along each axis."""

    origin: Float[np.ndarray, "3"]
    scale: float | Float[np.ndarray, "3"]
    proportions: Factors  # of the world, relative to the object's own space

    @classmethod
    def of(cls, instance: Instance, vertices: Float[np.ndarray, "vertices 3"], metres: float | None) -> "_Placing":
        """Place the object on the ground, ``metres`` long.

        None: as large as it was sized; without a size nothing changes.
        """
        low = vertices.min(0)
        high = vertices.max(0)
        on_ground = np.array([*(low + high)[:2] / 2, low[2]])
        proportions = instance.codes.proportions or UNIT
        if instance.is_sized:
            # These vertices get the size exactly: the bounds of any mesh differ a little from the field's.
            size = np.array(size_of(instance)) / 100
            return cls(on_ground, size * ((metres or size.max()) / size.max()) / (high - low), proportions)
        if metres is None:
            return cls(np.zeros(3, np.float32), 1.0, proportions)
        return cls(on_ground, float(metres / (high - low).max()), proportions)

    def vertices(self, vertices: Float[np.ndarray, "vertices 3"]) -> Float[np.ndarray, "vertices 3"]:
        """Return vertices in the file's units."""
        return (self.scale * (vertices - self.origin)).astype(np.float32)

    def normals(self, normals: Float[np.ndarray, "vertices 3"]) -> Float[np.ndarray, "vertices 3"]:
        """Return unit normals of the scaled surface."""
        if isinstance(self.scale, float):
            return normals
        turned = normals / self.scale
        return (turned / np.linalg.norm(turned, axis=1, keepdims=True)).astype(np.float32)

    @property
    def of_world(self) -> tuple[Float[np.ndarray, "3"], float]:
        """The file's origin in the world, and its units per scene unit."""
        proportions = np.array(self.proportions)
        return self.origin * proportions, float(np.mean(self.scale / proportions))


def _textured(
    instance: Instance, mesh: Mesh, pixels: int, detail: DetailMaps | None
) -> Generator[float, None, TexturedMesh]:
    """Put the field's colours and the photo detail into an image; world axes, scene units."""
    folded = FoldedField.of(instance)
    interval = 2 * max(instance.model.extent) / _INTERVALS

    def colours(places: np.ndarray, normals: np.ndarray) -> Generator[float, None, np.ndarray]:
        own = yield from _vertex_colours(folded, places, normals, interval)
        return _with_detail(own, places, normals, detail)

    return textured(mesh.vertices, mesh.faces, mesh.part_counts, colours, pixels)


def _with_detail(
    colours: Float[np.ndarray, "points 3"],
    places: Float[np.ndarray, "points 3"],
    normals: Float[np.ndarray, "points 3"],
    detail: DetailMaps | None,
) -> Float[np.ndarray, "points 3"]:
    """Add the photo detail to colours."""
    if detail is None:
        return colours
    with torch.inference_mode():
        device = detail.photos[0].surface.device
        points, outward, own = (torch.from_numpy(array).float().to(device) for array in (places, normals, colours))
        return (own + detail.colour_changes(points, -outward, own)[0]).clamp(0, 1).cpu().numpy()


def extract_mesh(instance: Instance, resolution: int | None = None, triangles: int = 0) -> Generator[float, None, Mesh]:
    """Extract the surface of an object; yields the fraction done.

    Drops pieces smaller than a twentieth of the object's diagonal, and walls of cavities that are invisible from
    outside. Raises ``ValueError`` for a resolution out of range, or if there is no surface.

    Args:
        resolution: cells along the longest side of the model's box; None: the first of :data:`RESOLUTIONS` whose area
            has stopped growing and whose surface lies within :data:`TOLERANCE`, else the last.
        triangles: at most, by quadric error; 0: all.
    """
    if resolution is not None and not 8 <= resolution <= MAX_RESOLUTION:
        raise ValueError(f"a mesh has a resolution of 8 to {MAX_RESOLUTION}, got {resolution}")
    folded = FoldedField.of(instance)
    occupancy = shape_occupancy(instance)
    area = 0.0
    surface: tuple[np.ndarray, np.ndarray] | None = None
    tries = (resolution,) if resolution else RESOLUTIONS
    for index, cells in enumerate(tries):
        grid = _Grid.for_model(instance.model, cells)
        begin, end = (_GRID_FRACTION * number / len(tries) for number in (index, index + 1))
        surface = yield from subprogress(_marching_cubes(folded, occupancy, grid), begin, end)
        if surface is None:
            continue
        vertices, faces = surface
        triangle_normals = face_normals(vertices, faces)
        before = area
        area = float(np.linalg.norm(triangle_normals, axis=1).sum())
        # Parts thinner than a cell are missing and add to the area once a finer grid finds them.
        if (
            area < (1 + _MAX_OFF_SURFACE) * before
            and _off_surface_fraction(folded, grid, vertices, faces, triangle_normals) < _MAX_OFF_SURFACE
        ):
            break
    if surface is None:
        raise ValueError("the object has no surface: its density is too low everywhere")
    if 0 < triangles < len(faces):
        vertices, faces = yield from subprogress(simplify(vertices, faces, triangles), end, end)
    return (yield from subprogress(_to_mesh(instance.model, folded, vertices, faces, grid.interval), end, 1.0))


def _to_mesh(
    model: Model, folded: FoldedField, vertices: np.ndarray, faces: np.ndarray, interval: float
) -> Generator[float, None, Mesh]:
    """Add normals, colours and parts to a surface; yields the fraction done."""
    normals = vertex_normals(len(vertices), faces, face_normals(vertices, faces))
    faces, part_counts = by_part(model, folded, vertices, faces)
    colours = yield from _vertex_colours(folded, vertices, normals, interval)
    return Mesh(vertices, normals, colours, faces, part_counts)


@dataclass(frozen=True, eq=False)
class _Grid:
    """Corners over the model's box, with a layer of empty corners around it that closes every surface."""

    half: Float[np.ndarray, "3"]
    counts: tuple[int, int, int]  # corners along x, y, z, including the empty ones
    step: Float[np.ndarray, "3"]  # scene units from one corner to the next
    interval: float  # scene units

    @classmethod
    def for_model(cls, model: Model, resolution: int) -> "_Grid":
        half = np.array(model.extent)
        cells = [math.ceil(resolution * side / max(model.extent) - 1e-9) for side in model.extent]
        interval = 2 * max(model.extent) / _INTERVALS
        return cls(half, (cells[0] + 3, cells[1] + 3, cells[2] + 3), 2 * half / np.array(cells), interval)

    def points(self, first: int, last: int) -> Float[Tensor, "planes y z 3"]:
        """Return corners of planes ``first`` to ``last`` (exclusive) without the empty ones at the other sides."""
        ranges = (np.arange(first, last), *(np.arange(1, count - 1) for count in self.counts[1:]))
        axes = [(r - 1) * s - h for r, s, h in zip(ranges, self.step, self.half, strict=True)]
        return torch.stack(torch.meshgrid(*(torch.from_numpy(axis).float() for axis in axes), indexing="ij"), -1)


def _marching_cubes(
    folded: FoldedField, occupancy: Occupancy, grid: _Grid
) -> Generator[float, None, tuple[np.ndarray, np.ndarray] | None]:
    """Return vertices (scene units) and triangles of the surface on a grid; None if it does not meet the grid."""
    pieces = yield from _pieces(folded, occupancy, grid)
    if not pieces:
        return None
    vertices, faces = _remove_specks(*_weld(pieces), grid.step)
    return ((vertices - 1) * grid.step - grid.half).astype(np.float32), faces


def _off_surface_fraction(
    folded: FoldedField, grid: _Grid, vertices: np.ndarray, faces: np.ndarray, triangle_normals: np.ndarray
) -> float:
    """Return the fraction of the area that lies further than :data:`TOLERANCE` from the true surface."""
    areas = np.linalg.norm(triangle_normals, axis=1)
    chosen = np.searchsorted(areas.cumsum(), (np.arange(_PROBES) + 0.5) / _PROBES * areas.sum())
    middles = vertices[faces[chosen]].mean(1)
    outward = triangle_normals[chosen] / areas[chosen, None]
    sides = torch.from_numpy(np.concatenate((middles - TOLERANCE * outward, middles + TOLERANCE * outward))).float()
    below, above = (_thickness(folded, grid, sides.to(folded.device)).cpu() > math.log(2)).chunk(2)
    return 1 - float((below & ~above).float().mean())


@torch.inference_mode()
def _thickness(folded: FoldedField, grid: _Grid, points: Float[Tensor, "points 3"]) -> Float[Tensor, "points"]:
    """The optical depth of an interval at these points."""
    return folded.density(points)[0] * grid.interval


def _pieces(
    folded: FoldedField, occupancy: Occupancy, grid: _Grid
) -> Generator[float, None, list[tuple[np.ndarray, np.ndarray]]]:
    """Return vertices (in grid steps) and triangles of every non-empty slab; each slab begins at the last's end."""
    from skimage.measure import marching_cubes  # takes as long to import as half of torch

    pieces = []
    count = grid.counts[0]
    starts = range(0, count, _SLAB)
    planes = map_pieces(partial(_logits, folded, occupancy, grid), starts)
    border = np.empty((0, *grid.counts[1:]), np.float32)  # evaluated once: two evaluations may differ in the last bit
    for first, own in zip(starts, planes, strict=True):
        logits = np.concatenate((border, own))
        if logits.max() > 0:
            vertices, faces, _, _ = marching_cubes(logits, 0.0, gradient_direction="ascent")
            pieces.append((vertices.astype(np.float64) + np.array([first - len(border), 0, 0]), faces))
        border = own[-1:]
        yield min(first + _SLAB, count) / count
    return pieces


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
    _, kept, same = np.unique(vertices[on_plane], axis=0, return_index=True, return_inverse=True)
    target = np.arange(len(vertices))
    target[on_plane] = on_plane[kept[same.ravel()]]
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
    kept = size >= min(_MIN_PIECE, size.max())
    faces = faces[kept[piece[faces[:, 0]]]]
    used, renamed = np.unique(faces, return_inverse=True)
    return vertices[used], renamed.reshape(-1, 3)


def _vertex_colours(
    folded: FoldedField, vertices: np.ndarray, normals: np.ndarray, interval: float
) -> Generator[float, None, Float[np.ndarray, "vertices 3"]]:
    """Compute the paper's vertex colours: seen along the inverted normal, from just outside."""
    edges = torch.linspace(-1.0, 2.0, _COLOUR_SAMPLES + 1) * interval
    colours = []
    blocks = torch.from_numpy(np.stack((vertices, normals))).split(_BLOCK // _COLOUR_SAMPLES, 1)
    for block_colours in map_pieces(partial(_surface_colours, folded, edges.to(folded.device)), blocks):
        colours.append(block_colours)
        yield len(colours) / len(blocks)
    return np.concatenate(colours)


@torch.inference_mode()
def _surface_colours(
    folded: FoldedField, edges: Float[Tensor, "edges"], rays: Float[Tensor, "2 rays 3"]
) -> Float[np.ndarray, "rays 3"]:
    """Return the mean colour of the object along short rays.

    Args:
        rays: points of the surface, and its normals there.
    """
    positions, outward = rays.to(folded.device)
    middles = (edges[1:] + edges[:-1]) / 2
    points = positions[:, None] - middles[:, None] * outward[:, None]
    density, y = folded.density(points.flatten(0, 1))
    weights, _ = compositing_weights(density.reshape(points.shape[:2]), edges.expand(len(points), -1))
    towards = folded.direction_bias(-outward).repeat_interleave(len(middles), 0)
    colours = folded.colour(y, towards).reshape(points.shape).clamp(0, 1)
    return ((weights[..., None] * colours).sum(1) / weights.sum(1, keepdim=True).clamp_min(1e-9)).cpu().numpy()
