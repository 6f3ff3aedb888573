"""An object as a coloured triangle mesh in a file: its surface, named parts, and colours of field and photos."""

from collections.abc import Generator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from core.detail.lookup import DetailMaps
from core.detail.maps import detail_maps
from core.editing.size import size_of
from core.edits.edit import UNIT
from core.export.glb import glb
from core.export.mesh_formats import FORMATS, NEEDS_TEXTURE, TEXTURED, VARIED, save_mesh
from core.export.parts import by_part
from core.export.print_formats import LEAST_LEG, PRINTED, leg_thickness
from core.export.simplify import simplify
from core.export.surface import extract_surface, interval_of
from core.export.texture import TRIANGLES, textured
from core.export.triangle_mesh import Mesh, face_normals, vertex_normals
from core.export.variants import require_one_shape
from core.geometry.camera import Camera
from core.models.model import Instance
from core.rendering.compositing import compositing_weights
from core.rendering.folded_field import FoldedField
from core.runtime.files import atomic_file
from core.runtime.modes import isolated
from core.runtime.pool import map_pieces
from core.streams import subprogress

MIN_TRIANGLES = 100  # too few below to show a chair
TEXTURE = 1024  # px, width of the colour image of a format that needs one
_ROOM_TRIANGLES = 6000  # of a mesh for phones: seen small, and part of a page
_BLOCK = 4096  # points that a thread evaluates at a time, so that activations stay in cache
_COLOUR_SAMPLES = 8  # samples of the short ray that colours a vertex
_TEXTURE_FRACTION = 0.7  # fraction of the time of a textured mesh for the texture
_COLOUR_FRACTION = 0.4  # fraction of the time for the colours of vertices


@dataclass(frozen=True)
class MeshSettings:
    """Options of a mesh file. Raises ``ValueError`` for values out of range."""

    resolution: int | None = None
    """cells along the longest side of the model's box; None: as many as the object's detail needs"""
    metres: float | None = None
    """m, the object's longest side, standing on the ground; None: as large as the object was sized, else in scene units
    and centred at the origin"""
    texture: int = 0
    """px, approximate width of the colour image (glb, usdz); 0: colours per vertex, or :data:`TEXTURE` for a usdz"""
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
    instance: Instance,
    path: Path,
    settings: MeshSettings | None = None,
    camera: Camera | None = None,
    variants: Mapping[str, Instance] | None = None,
) -> Generator[float, None, str]:
    """Write an object's mesh to ``path``; a .glb also contains the camera. Return a doubt about it, "" for none.

    Yields the fraction done, 1.0 at the end. The file appears only when it is complete: to cancel, close the generator.
    Raises ``ValueError`` like :func:`extract_mesh`, and for an unknown format, a texture or variants in a format
    without them, variants of other shapes, or a path that cannot be written.

    Args:
        variants: objects of the same shape by name, whose colours the file holds instead; the first is shown at first.
    """
    settings = settings or MeshSettings()
    variants = variants or {"": instance}
    suffix = path.suffix.lower()
    pixels = settings.texture or (TEXTURE if suffix in NEEDS_TEXTURE or len(variants) > 1 else 0)
    _check(path, pixels, instance, variants)
    if settings.metres is None and suffix in NEEDS_TEXTURE:
        settings = replace(settings, metres=_usual_metres(instance))
    with atomic_file(path) as unfinished:
        mesh, origin, scale = yield from _placed(instance, settings, pixels, variants)
        if camera and suffix == ".glb":
            proportions = np.array(instance.codes.proportions or UNIT)
            view = camera, origin * proportions, float(np.mean(scale / proportions))
            unfinished.write_bytes(glb(mesh.in_gltf_axes(), view))
        else:
            save_mesh(mesh, unfinished)
    yield 1.0
    return _print_doubt(mesh) if suffix in PRINTED else ""


def room_mesh(instance: Instance, variants: Mapping[str, Instance]) -> Generator[float, None, Mesh]:
    """Return an object as phones place it in a room: few triangles, an image of each variant, in metres.

    Yields the fraction done.
    """
    settings = MeshSettings(metres=_usual_metres(instance), triangles=_ROOM_TRIANGLES)
    return (yield from _placed(instance, settings, TEXTURE, variants))[0]


def _usual_metres(instance: Instance) -> float | None:
    """Return the longest side in m of an object that has no size of its own."""
    return None if instance.is_sized else instance.model.metres


def _placed(
    instance: Instance, settings: MeshSettings, pixels: int, variants: Mapping[str, Instance]
) -> Generator[float, None, tuple[Mesh, Float[np.ndarray, "3"], float | Float[np.ndarray, "3"]]]:
    """Return the coloured mesh as a file holds it, and its :func:`_placement`; yields the fraction done.

    Args:
        pixels: width of the images; 0: colours at vertices.
    """
    end = 1 - (_TEXTURE_FRACTION if pixels else _COLOUR_FRACTION)
    triangles = settings.triangles or (TRIANGLES if pixels else 0)
    mesh = yield from subprogress(_bare_mesh(instance, settings.resolution, triangles), 0.0, end)
    colours = {}
    for name, variant in variants.items():
        detail = yield from subprogress(detail_maps(variant.unstretched), end, end)
        colours[name] = partial(_colours, variant, detail)
    if pixels:
        mesh = yield from subprogress(textured(mesh, colours, pixels), end, 1.0)
    else:
        first, *_ = colours.values()
        mesh = replace(mesh, colours=(yield from subprogress(first(mesh.vertices, mesh.normals), end, 1.0)))
    origin, scale = _placement(instance, mesh.vertices, settings.metres)
    normals = mesh.normals
    if instance.is_sized:
        normals = normals / scale
        normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    vertices = (scale * (mesh.vertices - origin)).astype(np.float32)
    return replace(mesh, vertices=vertices, normals=normals), origin, scale


def _print_doubt(mesh: Mesh) -> str:
    """Return a warning about legs that are too thin for a printer."""
    thickness = leg_thickness(mesh)
    if thickness is None or thickness >= LEAST_LEG:
        return ""
    return f"legs are about {thickness:.1f} mm thick, printers need {LEAST_LEG:g} mm: print it larger"


def _check(path: Path, pixels: int, instance: Instance, variants: Mapping[str, Instance]) -> None:
    """Raise ``ValueError`` for a format that does not hold the colours, or for variants of other shapes."""
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(f"{path.name}: a mesh file must end in {', '.join(FORMATS)}")
    if len(variants) > 1 and suffix not in VARIED:
        raise ValueError(f"{path.name}: only {', '.join(VARIED)} holds variants")
    if pixels and suffix not in TEXTURED:
        raise ValueError(f"{path.name}: only {', '.join(TEXTURED)} holds a texture")
    require_one_shape({"the object": instance, **variants})


def _placement(
    instance: Instance, vertices: Float[np.ndarray, "vertices 3"], metres: float | None
) -> tuple[Float[np.ndarray, "3"], float | Float[np.ndarray, "3"]]:
    """Return the origin of a file in the object's space, and its units in a scene unit, for each axis if sized.

    The object stands on the ground, ``metres`` long; None: as large as it was sized, without a size as it is.
    """
    low = vertices.min(0)
    high = vertices.max(0)
    on_ground = np.array([*(low + high)[:2] / 2, low[2]])
    if instance.is_sized:
        # These vertices get the size exactly: the bounds of any mesh differ a little from the field's.
        size = np.array(size_of(instance)) / 100
        return on_ground, size * ((metres or size.max()) / size.max()) / (high - low)
    if metres is None:
        return np.zeros(3, np.float32), 1.0
    return on_ground, float(metres / (high - low).max())


def extract_mesh(instance: Instance, resolution: int | None = None) -> Generator[float, None, Mesh]:
    """Extract the surface of an object in the field's colours; yields the fraction done.

    Arguments and errors are those of :func:`core.export.surface.extract_surface`.
    """
    end = 1 - _COLOUR_FRACTION
    mesh = yield from subprogress(_bare_mesh(instance, resolution, 0), 0.0, end)
    colours = _colours(instance, None, mesh.vertices, mesh.normals)
    return replace(mesh, colours=(yield from subprogress(colours, end, 1.0)))


def _bare_mesh(instance: Instance, resolution: int | None, triangles: int) -> Generator[float, None, Mesh]:
    """Return the surface of an object with normals and parts; yields the fraction done."""
    folded = FoldedField.of(instance)
    vertices, faces = yield from extract_surface(instance, folded, resolution)
    if 0 < triangles < len(faces):
        vertices, faces = yield from subprogress(simplify(vertices, faces, triangles), 1.0, 1.0)
    normals = vertex_normals(len(vertices), faces, face_normals(vertices, faces))
    return Mesh(vertices, normals, *by_part(instance.model, folded, vertices, faces))


def _colours(
    instance: Instance,
    detail: DetailMaps | None,
    points: Float[np.ndarray, "points 3"],
    normals: Float[np.ndarray, "points 3"],
) -> Generator[float, None, Float[np.ndarray, "points 3"]]:
    """Compute the paper's vertex colours, seen along the inverted normal from just outside, with the photo detail.

    Yields the fraction done.
    """
    folded = FoldedField.of(instance)
    edges = torch.linspace(-1.0, 2.0, _COLOUR_SAMPLES + 1) * interval_of(instance.model)
    pieces = []
    blocks = torch.from_numpy(np.stack((points, normals))).split(_BLOCK // _COLOUR_SAMPLES, 1)
    for block_colours in map_pieces(partial(_surface_colours, folded, edges.to(folded.device)), blocks):
        pieces.append(block_colours)
        yield len(pieces) / len(blocks)
    colours = np.concatenate(pieces)
    if detail is None:
        return colours
    with torch.inference_mode():
        device = detail.photos[0].surface.device
        positions, outward, network = (
            torch.from_numpy(array).float().to(device) for array in (points, normals, colours)
        )
        return (network + detail.colour_changes(positions, -outward, network)[0]).clamp(0, 1).cpu().numpy()


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
