"""Render a folder of GLB meshes into a dataset; ``index.json`` lists the files with their categories."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float, UInt8
from PIL import Image

from core.geometry.camera import WORLD_FROM_GLTF
from core.lab.datasets.categories import Split
from core.lab.datasets.mesh_variants import deformed, pairs, recoloured
from core.lab.datasets.rasteriser import Surface
from core.lab.datasets.render_objects import RenderTask
from core.lab.datasets.splits import held_out_meshes
from core.runtime.reading import read_json, reading, typed

TURN_TO_FRONT = {
    "quaternius_oct2017_chair": -90,
    "quaternius_oct2017_chaircushioned": -90,
    "quaternius_oct2017_chairhandle": -90,
}  # degrees about the vertical that turn the front of a mesh to +y, for files with another front


@dataclass(frozen=True)
class MeshEntry:
    """An entry of a mesh folder's index."""

    name: str
    category: str
    path: Path


class _Line(NamedTuple):
    """JSON of an index entry."""

    id: str
    category: str
    file: str


def select_meshes(folder: Path | str, category: str, split: Split) -> tuple[MeshEntry, ...]:
    """Return a split's meshes in the index's order. Raises ``ValueError`` for a folder without an index."""
    index = Path(folder) / "index.json"
    with reading(index, "a mesh index"):
        lines = typed(tuple[_Line, ...], read_json(index), name="index")
    entries = [MeshEntry(line.id, line.category, Path(folder) / line.file) for line in lines]
    split_of = {name: held for held, names in held_out_meshes(category).items() for name in names}
    selected = tuple(e for e in entries if e.category == category and split_of.get(e.name, "train") == split)
    if not selected:
        raise ValueError(f"{index}: no {category} in the {split} split")
    return selected


def mesh_tasks(folder: Path | str, category: str, split: Split, variants: int = 0) -> tuple[RenderTask, ...]:
    """Return render tasks of every mesh of :func:`select_meshes`.

    Adds ``variants`` deformed shapes of each, in as many recolourings (:mod:`core.lab.datasets.mesh_variants`). Raises
    ``ValueError`` for a negative number of variants.
    """
    if variants < 0:
        raise ValueError(f"the number of variants must not be negative, got {variants}")
    meshes = select_meshes(folder, category, split)
    return tuple(_render_task(entry, *pair) for entry in meshes for pair in pairs(variants))


def _render_task(entry: MeshEntry, shape: int, recolouring: int) -> RenderTask:
    """Describe a mesh with a shape and a recolouring; 0 keeps the mesh's own.

    Names occur in the shipped models and seed the cameras.
    """
    shape_id = f"{entry.name}-form{shape}" if shape else entry.name
    texture_id = f"{entry.name}-look{recolouring}" if recolouring else entry.name
    name = f"{shape_id}-look{recolouring}" if recolouring else shape_id
    return RenderTask(name, shape_id, texture_id, partial(_variant, entry, shape, recolouring))


def _variant(entry: MeshEntry, shape: int, recolouring: int) -> tuple[Surface, ...]:
    surfaces = load_mesh(entry.path, TURN_TO_FRONT.get(entry.name, 0.0))
    return normalised(deformed(recoloured(surfaces, entry.name, recolouring), entry.name, shape))


def load_mesh(path: Path | str, turn: float = 0.0) -> tuple[Surface, ...]:
    """Load a GLB's surfaces into the world: centred, bounding box diagonal 1, base colours only.

    Args:
        path: the file; glTF axes.
        turn: degrees about the world's vertical, counter-clockwise seen from above.

    Raises ``ValueError`` naming the file if it is unreadable or holds no triangles.
    """
    with reading(path, "a mesh"):
        scene = trimesh.load_scene(path)
    about_z = trimesh.transformations.rotation_matrix(np.radians(turn), (0, 0, 1))[:3, :3]
    surfaces = []
    for node in sorted(scene.graph.nodes_geometry):
        transform, name = scene.graph[node]
        geometry = scene.geometry[name]
        if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces):
            surfaces.append(_surface(geometry, about_z @ WORLD_FROM_GLTF @ transform[:3]))
    if not surfaces:
        raise ValueError(f"{path}: holds no triangles")
    return normalised(surfaces)


def normalised(surfaces: Sequence[Surface]) -> tuple[Surface, ...]:
    """Scale and centre an object: bounding box around the origin, diagonal 1 (ShapeNet v2's scale)."""
    used = np.vstack([surface.vertices[np.unique(surface.faces)] for surface in surfaces])
    low = used.min(0)
    high = used.max(0)
    scale = 1.0 / max(float(np.linalg.norm(high - low)), 1e-12)
    middle = (low + high) / 2
    return tuple(
        Surface((s.vertices - middle) * scale, s.normals, s.faces, s.colours, s.uvs, s.texture) for s in surfaces
    )


def _surface(geometry: trimesh.Trimesh, placed: Float[np.ndarray, "3 4"]) -> Surface:
    """Place one mesh of the scene graph in the world by a 3x3 matrix and a shift."""
    vertices = geometry.vertices @ placed[:, :3].T + placed[:, 3]
    # Normals turn with the inverse transpose; the cofactors equal it up to scale and never divide by zero.
    a, b, c = placed[:, :3].T
    normals = geometry.vertex_normals @ np.stack((np.cross(b, c), np.cross(c, a), np.cross(a, b)))
    colours, uvs, texture = _appearance(geometry)
    return Surface(vertices, normals, np.asarray(geometry.faces), colours, uvs, texture)


def _appearance(
    geometry: trimesh.Trimesh,
) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "v 2"] | None, UInt8[np.ndarray, "h w 4"] | None]:
    """Return colours, texture coordinates and texture from vertex colours, or the material's factor and image."""
    count = len(geometry.vertices)
    visual = geometry.visual
    if isinstance(visual, trimesh.visual.ColorVisuals):
        return np.asarray(visual.vertex_colors)[:, :3] / 255.0, None, None
    if visual is None:
        return np.ones((count, 3)), None, None
    material = visual.material
    factor = getattr(material, "baseColorFactor", None)
    factor = (255, 255, 255) if factor is None else np.asarray(factor)[:3]
    colours = np.tile(np.asarray(factor, np.float64) / 255.0, (count, 1))
    image = getattr(material, "baseColorTexture", None)
    if not isinstance(image, Image.Image) or visual.uv is None:
        return colours, None, None
    # trimesh measures v from the image's bottom.
    uvs = np.asarray(visual.uv) * (1.0, -1.0) + (0.0, 1.0)
    return colours, uvs, np.asarray(image.convert("RGBA"))
