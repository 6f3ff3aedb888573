"""A textured mesh as .usdz, the file that iPhones place in a room: a layer of text and its image in a plain zip.

Members are not compressed and begin at multiples of 64 bytes, so that a reader can map them into memory.
"""

import io
import re
import zipfile
from pathlib import Path

import numpy as np
from PIL import Image

from core.export.triangle_mesh import Mesh

_ALIGNMENT = 64  # bytes
_LOCAL_HEADER = 30  # bytes of a member's header before its name
_PADDING_ID = 0x1986  # of the extra field that fills a header; readers skip fields that they do not know
_LAYER, _IMAGE = "object.usda", "colours.jpg"
_QUALITY = 90  # of the JPEG
_DIGITS = 5  # of lengths in m, normals and texture coordinates
_ROOT = """#usda 1.0
(
    defaultPrim = "object"
    metersPerUnit = 1
    upAxis = "Y"
)

def Xform "object" (
    kind = "component"
)
{{
    def Material "colours"
    {{
        token outputs:surface.connect = </object/colours/surface.outputs:surface>

        def Shader "surface"
        {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </object/colours/image.outputs:rgb>
            float inputs:metallic = 0
            float inputs:roughness = 1
            token outputs:surface
        }}

        def Shader "place"
        {{
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }}

        def Shader "image"
        {{
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @{image}@
            token inputs:sourceColorSpace = "sRGB"
            float2 inputs:st.connect = </object/colours/place.outputs:result>
            token inputs:wrapS = "clamp"
            token inputs:wrapT = "clamp"
            float3 outputs:rgb
        }}
    }}
{parts}}}
"""
_PART = """
    def Mesh "{name}" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {{
        float3[] extent = {extent}
        int[] faceVertexCounts = {counts}
        int[] faceVertexIndices = {corners}
        normal3f[] normals = {normals} (
            interpolation = "vertex"
        )
        point3f[] points = {points}
        texCoord2f[] primvars:st = {uv} (
            interpolation = "vertex"
        )
        uniform token subdivisionScheme = "none"
        rel material:binding = </object/colours>
    }}
"""


def write_usdz(mesh: Mesh, path: Path | io.BytesIO) -> None:
    """Write the first image of a textured mesh in m, with y up and its front at +z."""
    image = io.BytesIO()
    Image.fromarray(next(iter(mesh.images.values()))).save(image, "JPEG", quality=_QUALITY)
    parts = "".join(_part(name, part) for name, part in mesh.in_gltf_axes().parts())
    layer = _ROOT.format(image=_IMAGE, parts=parts).encode()
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as file:
        for name, data in ((_LAYER, layer), (_IMAGE, image.getvalue())):  # the first member is what readers open
            member = zipfile.ZipInfo(name)
            begin = file.start_dir + _LOCAL_HEADER + len(name) + 4  # with the header of the extra field
            filling = bytes(-begin % _ALIGNMENT)
            member.extra = b"".join(number.to_bytes(2, "little") for number in (_PADDING_ID, len(filling))) + filling
            file.writestr(member, data)


def _part(name: str, part: Mesh) -> str:
    assert part.uv is not None, "a .usdz has a texture"
    return _PART.format(
        name=re.sub(r"\W|^(?=\d)", "_", name, flags=re.ASCII),
        extent=_tuples(np.stack((part.vertices.min(0), part.vertices.max(0)))),
        counts=[3] * len(part.faces),
        corners=part.faces.ravel().tolist(),
        normals=_tuples(part.normals),
        points=_tuples(part.vertices),
        uv=_tuples(part.uv),
    )


def _tuples(rows: np.ndarray) -> str:
    return f"[{', '.join(map(str, map(tuple, rows.astype(float).round(_DIGITS).tolist())))}]"
