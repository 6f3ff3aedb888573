"""Mesh files for printers, z up, in millimetres: .stl, and .3mf with a colour for each part.

A part's triangles are painted as slicers do it: every triangle names its filament, and the mesh stays one closed body.
"""

import zipfile
from pathlib import Path

import numpy as np
from jaxtyping import Float

from core.export.triangle_mesh import Mesh, face_normals
from core.geometry.pixels import to_bytes

PRINTED = (".stl", ".3mf")  # formats for printers
LARGEST_PRINT = 1.0  # m, side of the space of the largest usual printers
LEAST_LEG = 0.8  # mm, two lines of a usual nozzle; thinner legs break or are left out
_MILLIMETRES = 1000  # per metre; programs for printing expect millimetres
_SECTIONS = np.linspace(0.1, 0.5, 9)  # heights of legs that are measured: above feet, below the seat
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


def write_stl(mesh: Mesh, path: Path) -> None:
    """Write a mesh without colours."""
    import trimesh  # imported late: the window only lists the formats

    vertices = _MILLIMETRES * mesh.vertices
    trimesh.Trimesh(vertices, mesh.faces, vertex_normals=mesh.normals, process=False).export(path)


def write_3mf(mesh: Mesh, path: Path) -> None:
    """Write a mesh whose parts are named materials, and filaments in their order."""
    bases: list[str] = []
    attributes: list[str] = []
    for number, (name, part) in enumerate(mesh.parts()):
        red, green, blue = to_bytes(_mean_colour(part))
        bases.append(f'<base name="{name}" displaycolor="#{red:02X}{green:02X}{blue:02X}"/>')
        code = _filament_code(number)
        painted = f'pid="1" p1="{number}" slic3rpe:mmu_segmentation="{code}" paint_color="{code}"'
        attributes += [painted] * len(part.faces)
    corners = zip(mesh.faces.tolist(), attributes, strict=True)
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}" {painted}/>' for (a, b, c), painted in corners)
    points = (_MILLIMETRES * mesh.vertices).tolist()
    vertices = "".join(f'<vertex x="{x:.5f}" y="{y:.5f}" z="{z:.5f}"/>' for x, y, z in points)
    spaces = f'xmlns="{_3MF}/core/2015/02" xmlns:slic3rpe="http://schemas.slic3r.org/3mf/2017/06"'
    model = f"""{_HEAD}<model unit="millimeter" {spaces}>
<metadata name="slic3rpe:MmPaintingVersion">1</metadata>
<resources><basematerials id="1">{"".join(bases)}</basematerials><object id="2" type="model" pid="1" pindex="0"><mesh>
<vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh></object></resources>
<build><item objectid="2"/></build></model>"""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, text in (*_3MF_PARTS.items(), ("3D/3dmodel.model", model)):
            file.writestr(name, text)


def _filament_code(number: int) -> str:
    """Return the text by which slicers paint a whole triangle with a filament, counted from 0."""
    return ("4", "8")[number] if number < 2 else f"{number - 2:X}C"


def _mean_colour(part: Mesh) -> Float[np.ndarray, "3"]:
    """Return the mean colour of a part's surface, sRGB 0..1."""
    assert part.colours is not None, "files for printers take the colours of vertices"
    areas = np.linalg.norm(face_normals(part.vertices, part.faces), axis=1)
    return (areas[:, None] * part.colours[part.faces].mean(1)).sum(0) / areas.sum()


def leg_thickness(mesh: Mesh) -> float | None:
    """Return the thickness of a mesh's legs in mm, at the height where they are thinnest; None without legs.

    It is the diameter of round legs, and the side of square ones.
    """
    legs = dict(mesh.parts()).get("legs")
    if legs is None:
        return None
    heights = np.quantile(legs.vertices[:, 2], (0, 1)) @ (1 - _SECTIONS, _SECTIONS)
    return _MILLIMETRES * min(_section_thickness(legs, height) for height in heights)


def _section_thickness(legs: Mesh, height: float) -> float:
    """Return four times the area of a horizontal section over its perimeter; infinite where there is none."""
    corners = legs.vertices[legs.faces].astype(float)
    ends = np.roll(corners, -1, axis=1)
    crosses = (corners[..., 2] > height) != (ends[..., 2] > height)  # two edges of a triangle, or none
    cut = crosses.any(1)
    if not cut.any():
        return np.inf
    start = corners[crosses]
    edges = ends[crosses] - start
    points = start + edges * ((height - start[:, 2]) / edges[:, 2])[:, None]
    first, second = points.reshape(-1, 2, 3)[..., :2].swapaxes(0, 1)
    lengths = np.linalg.norm(second - first, axis=1)
    outward = face_normals(legs.vertices, legs.faces)[cut, :2]
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-30)
    middles = (first + second) / 2
    area = ((middles - middles.mean(0)) * outward).sum(1) @ lengths / 2
    return 4 * area / lengths.sum()
