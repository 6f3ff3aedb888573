"""Mesh files: .glb, .ply, .obj, and .stl and .3mf for printing."""

import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from core.export.glb import MeshParts, glb
from core.geometry.camera import WORLD_FROM_GLTF
from core.geometry.pixels import to_bytes

PRINTED = (".stl", ".3mf")  # formats for printers
LARGEST_PRINT = 1.0  # m, side of the space of the largest usual printers
_MILLIMETRES = 1000  # per metre; programs for printing expect millimetres
_3MF = "http://schemas.microsoft.com/3dmanufacturing"
_PACKAGE = "http://schemas.openxmlformats.org/package/2006"
_HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'
_3MF_PARTS = {
    "[Content_Types].xml": f"""{_HEAD}<Types xmlns="{_PACKAGE}/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>""",
    "_rels/.rels": f"""{_HEAD}<Relationships xmlns="{_PACKAGE}/relationships">
<Relationship Id="rel0" Target="/3D/3dmodel.model" Type="{_3MF}/2013/01/3dmodel"/></Relationships>""",
}


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed surface whose triangles are counter-clockwise seen from outside."""

    vertices: Float[np.ndarray, "vertices 3"]  # world, scene units or m
    normals: Float[np.ndarray, "vertices 3"]  # unit length, outward
    colours: Float[np.ndarray, "vertices 3"]  # sRGB, 0..1
    faces: Int[np.ndarray, "faces 3"]
    part_counts: MeshParts

    def save(self, path: Path) -> None:
        """Write the mesh in the format of the name's ending, one of :data:`FORMATS`."""
        FORMATS[path.suffix.lower()](self, path)


def _write_glb(mesh: Mesh, path: Path) -> None:
    """Write with glTF axes: y up, front +z."""
    vertices = mesh.vertices @ WORLD_FROM_GLTF
    normals = mesh.normals @ WORLD_FROM_GLTF
    path.write_bytes(glb(vertices, normals, mesh.faces, mesh.part_counts, colours=mesh.colours))


def _write_ply(mesh: Mesh, path: Path) -> None:
    _trimesh(mesh).export(path, vertex_normal=True)


def _write_obj(mesh: Mesh, path: Path) -> None:
    """Write with glTF's axes, which readers of this format expect, too; parts are objects that share vertices."""
    turned = replace(mesh, vertices=mesh.vertices @ WORLD_FROM_GLTF, normals=mesh.normals @ WORLD_FROM_GLTF)
    head, *triangles = _trimesh(turned).export(file_type="obj").split("\nf ")
    rest = iter(triangles)
    objects = ["\nf ".join((f"o {name}", *islice(rest, count))) for name, count in mesh.part_counts]
    path.write_text("\n".join((head, *objects)))


def _write_stl(mesh: Mesh, path: Path) -> None:
    """Write with z up, in mm, without colours."""
    _trimesh(replace(mesh, vertices=_MILLIMETRES * mesh.vertices)).export(path)


def _write_3mf(mesh: Mesh, path: Path) -> None:
    """Write with z up, in mm, a colour at each vertex (the extension *Materials and Properties*)."""
    palette, colour_index = np.unique(to_bytes(mesh.colours), axis=0, return_inverse=True)
    colours = "".join(f'<m:color color="#{red:02X}{green:02X}{blue:02X}FF"/>' for red, green, blue in palette.tolist())
    places = (_MILLIMETRES * mesh.vertices).tolist()
    vertices = "".join(f'<vertex x="{x:.5f}" y="{y:.5f}" z="{z:.5f}"/>' for x, y, z in places)
    corners = zip(mesh.faces.tolist(), colour_index.reshape(-1)[mesh.faces].tolist(), strict=True)
    triangles = "".join(
        f'<triangle v1="{a}" v2="{b}" v3="{c}" pid="1" p1="{p}" p2="{q}" p3="{r}"/>' for (a, b, c), (p, q, r) in corners
    )
    model = f"""{_HEAD}<model unit="millimeter" xmlns="{_3MF}/core/2015/02" xmlns:m="{_3MF}/material/2015/02">
<resources><m:colorgroup id="1">{colours}</m:colorgroup><object id="2" type="model"><mesh>
<vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh></object></resources>
<build><item objectid="2"/></build></model>"""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, text in (*_3MF_PARTS.items(), ("3D/3dmodel.model", model)):
            file.writestr(name, text)


def _trimesh(mesh: Mesh) -> Any:
    """Convert the mesh, in the world's axes, to trimesh."""
    import trimesh  # imported late: the window only lists the formats

    colours = to_bytes(mesh.colours)
    converted = trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_normals=mesh.normals, process=False)
    converted.visual = trimesh.visual.ColorVisuals(converted, vertex_colors=colours)
    return converted


FORMATS: dict[str, Callable[[Mesh, Path], None]] = {
    ".glb": _write_glb,
    ".ply": _write_ply,
    ".obj": _write_obj,
    ".stl": _write_stl,
    ".3mf": _write_3mf,
}  # writer of each format, by the name's ending
TEXTURED = (".glb",)  # formats that can hold a texture
