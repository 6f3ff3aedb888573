"""Render a folder of GLB meshes into a dataset; ``index.json`` lists the files with their categories."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float, UInt8
from PIL import Image

from core.geometry.camera import WORLD_FROM_GLTF
from core.lab.datasets.categories import Split, held_out_meshes
from core.lab.datasets.mesh_variants import deformed, pairs, recoloured
from core.lab.datasets.rasteriser import Rasteriser, Surface
from core.lab.datasets.srn import ObjectViews, write_manifest, write_object
from core.lab.datasets.srn_cameras import split_cameras
from core.runtime.reading import open_image, read_json, reading, typed

TURN_TO_FRONT = {
    "quaternius_oct2017_chair": -90,
    "quaternius_oct2017_chaircushioned": -90,
    "quaternius_oct2017_chairhandle": -90,
}  # degrees about the vertical that turn the front of a mesh to +y, for files with another front


class MeshEntry(NamedTuple):
    """A mesh in the index of a folder."""

    id: str
    category: str
    file: Path  # relative to the folder in JSON


class RenderTask(NamedTuple):
    """A mesh to render, deformed and recoloured (:mod:`core.lab.datasets.mesh_variants`)."""

    mesh: MeshEntry
    shape: int  # 0 is the mesh's own
    recolouring: int

    @property
    def identity(self) -> tuple[str, str, str]:
        """Names of the object, its shape and its texture: they occur in the shipped models and seed the cameras."""
        shape = f"-form{self.shape}" if self.shape else ""
        look = f"-look{self.recolouring}" if self.recolouring else ""
        return f"{self.mesh.id}{shape}{look}", f"{self.mesh.id}{shape}", f"{self.mesh.id}{look}"

    def surfaces(self) -> tuple[Surface, ...]:
        """Load the mesh and change it."""
        name = self.mesh.id
        surfaces = load_mesh(self.mesh.file, TURN_TO_FRONT.get(name, 0.0))
        return normalised(deformed(recoloured(surfaces, name, self.recolouring), name, self.shape))


def select_meshes(folder: Path | str, category: str, split: Split) -> tuple[MeshEntry, ...]:
    """Return a split's meshes in the index's order. Raises ``ValueError`` for a folder without an index."""
    index = Path(folder) / "index.json"
    with reading(index, "a mesh index"):
        entries = typed(tuple[MeshEntry, ...], read_json(index), name="index")
    split_of = {name: held for held, names in held_out_meshes(category).items() for name in names}
    selected = [entry for entry in entries if entry.category == category and split_of.get(entry.id, "train") == split]
    if not selected:
        raise ValueError(f"{index}: no {category} in the {split} split")
    return tuple(entry._replace(file=Path(folder) / entry.file) for entry in selected)


def mesh_tasks(folder: Path | str, category: str, split: Split, variants: int = 0) -> tuple[RenderTask, ...]:
    """Return render tasks of every mesh of :func:`select_meshes`, with ``variants`` deformed shapes of each."""
    meshes = select_meshes(folder, category, split)
    return tuple(RenderTask(entry, *pair) for entry in meshes for pair in pairs(variants))


def render_objects(
    tasks: Sequence[RenderTask], out: Path | str, category: str, split: Split, views: int, size: int
) -> Iterator[str]:
    """Render the tasks into the dataset ``out``, yielding each name when it is done.

    Skips objects that exist with as many views of this size, so a stopped job resumes. Raises ``RuntimeError`` without
    OpenGL, ``ValueError`` for an object that cannot be built.
    """
    write_manifest(out, category, {task.identity[0]: task.identity[1:] for task in tasks})
    with Rasteriser(size) as rasteriser:
        for task in tasks:
            name = task.identity[0]
            if not _is_rendered(Path(out) / name, views, size):
                rasteriser.upload(task.surfaces())
                cameras = split_cameras(split, views, name, category, size)
                images, masks = zip(*(rasteriser.render(camera) for camera in cameras), strict=True)
                write_object(out, ObjectViews(*task.identity, np.stack(images), np.stack(masks), cameras))
            yield name


def _is_rendered(folder: Path, views: int, size: int) -> bool:
    """True if an object's folder holds this many images of this size."""
    paths = list((folder / "rgb").glob("*.png"))
    if len(paths) != views:
        return False
    with open_image(paths[0]) as opened:
        return opened.size == (size, size)


def load_mesh(path: Path | str, turn: float = 0.0) -> tuple[Surface, ...]:
    """Load a GLB's surfaces into the world: centred, bounding box diagonal 1, base colours only.

    ``turn``: degrees about the world's vertical, counter-clockwise seen from above. Raises ``ValueError`` naming the
    file if it is unreadable or holds no triangles.
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
    return tuple(replace(surface, vertices=(surface.vertices - middle) * scale) for surface in surfaces)


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
