"""Mesh files by the ending of their name: .glb, .usdz for phones, .ply, .obj, and .stl and .3mf for printers."""

from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Any

from core.export.glb import glb
from core.export.print_formats import write_3mf, write_stl
from core.export.triangle_mesh import Mesh
from core.export.usdz import write_usdz
from core.geometry.pixels import to_bytes


def save_mesh(mesh: Mesh, path: Path) -> None:
    """Write a mesh in the format of the name's ending, one of :data:`FORMATS`."""
    FORMATS[path.suffix.lower()](mesh, path)


def _write_obj(mesh: Mesh, path: Path) -> None:
    """Write parts as objects that share vertices."""
    head, *triangles = _trimesh(mesh.in_gltf_axes()).export(file_type="obj").split("\nf ")
    rest = iter(triangles)
    objects = ["\nf ".join((f"o {name}", *islice(rest, count))) for name, count in mesh.part_counts]
    path.write_text("\n".join((head, *objects)))


def _trimesh(mesh: Mesh) -> Any:
    import trimesh  # imported late: the window only lists the formats

    assert mesh.colours is not None, "these files have the colours of vertices"
    converted = trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_normals=mesh.normals, process=False)
    converted.visual = trimesh.visual.ColorVisuals(converted, vertex_colors=to_bytes(mesh.colours))
    return converted


FORMATS: dict[str, Callable[[Mesh, Path], object]] = {
    ".glb": lambda mesh, path: path.write_bytes(glb(mesh.in_gltf_axes())),
    ".usdz": write_usdz,
    ".ply": lambda mesh, path: _trimesh(mesh).export(path, vertex_normal=True),
    ".obj": _write_obj,
    ".stl": write_stl,
    ".3mf": write_3mf,
}  # writer of each format, by the name's ending
TEXTURED = (".glb", ".usdz")  # formats that can hold a texture
NEEDS_TEXTURE = (".usdz",)  # formats that hold no colours of vertices, and lengths in metres only
VARIED = (".glb",)  # formats that can hold variants
