"""A mesh with its colours in an image: unwrapped by xatlas, every texel coloured by the field."""

from collections.abc import Callable, Generator, Mapping

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import distance_transform_edt

from core.export.triangle_mesh import Mesh, face_normals, vertex_normals
from core.geometry.pixels import to_bytes
from core.streams import subprogress

TRIANGLES = 8000  # at most in a textured surface: details are in the image
_PADDING = 4  # px between the pieces of the atlas
_UNWRAP_FRACTION = 0.1  # fraction of the time for unwrapping; the rest is colours

Colours = Callable[
    [Float[np.ndarray, "points 3"], Float[np.ndarray, "points 3"]],
    Generator[float, None, Float[np.ndarray, "points 3"]],
]  # points and outward normals to colours (sRGB, 0..1); yields the fraction done


def textured(mesh: Mesh, colours: Mapping[str, Colours], pixels: int) -> Generator[float, None, Mesh]:
    """Unwrap a surface once and colour an image of each variant, about ``pixels`` wide; yields the fraction done.

    Raises ``ValueError`` if the library that unwraps surfaces is missing.
    """
    yield 0.0
    original, corners, uv, (width, height) = _unwrapped(mesh.vertices, mesh.faces, pixels)
    yield _UNWRAP_FRACTION
    points = mesh.vertices[original].astype(np.float32)
    faces = original[corners]  # both sides of a seam share the original vertex's normal
    normals = vertex_normals(len(mesh.vertices), faces, face_normals(mesh.vertices, faces))[original]
    covered, triangle, weights = _texels(uv * (width, height), corners, (width, height))
    texels = [(weights[..., None] * array[corners[triangle]]).sum(1).astype(np.float32) for array in (points, normals)]
    texels[1] /= np.maximum(np.linalg.norm(texels[1], axis=1, keepdims=True), 1e-9)
    images = {}
    for number, (name, colour) in enumerate(colours.items()):
        begin, end = (
            _UNWRAP_FRACTION + (1 - _UNWRAP_FRACTION) * count / len(colours) for count in (number, number + 1)
        )
        image = np.zeros((height, width, 3), np.uint8)
        image[covered] = to_bytes((yield from subprogress(colour(*texels), begin, end)))
        # The nearest colour fills uncovered texels, so that smaller images show no seams.
        images[name] = image[tuple(distance_transform_edt(~covered, return_distances=False, return_indices=True))]
    return Mesh(points, normals, corners, mesh.part_counts, uv=uv * (1, -1) + (0, 1), images=images)


def _unwrapped(
    vertices: np.ndarray, faces: np.ndarray, pixels: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[int, int]]:
    """Unwrap a mesh. Return original vertex indices, triangles, uv (0..1) and the image's size in px."""
    try:
        import xatlas
    except ImportError:
        raise ValueError("a texture needs the library xatlas; choose vertex colours") from None

    atlas = xatlas.Atlas()
    atlas.add_mesh(vertices.astype(np.float32), faces.astype(np.uint32))
    options = xatlas.PackOptions()
    options.resolution = pixels
    options.padding = _PADDING
    options.bilinear = True
    atlas.generate(pack_options=options)
    original, corners, uv = atlas[0]
    return original.astype(np.int64), corners.astype(np.int64), uv.astype(np.float64), (atlas.width, atlas.height)


def _texels(
    points: Float[np.ndarray, "vertices 2"], faces: Int[np.ndarray, "faces 3"], size: tuple[int, int]
) -> tuple[Bool[np.ndarray, "height width"], Int[np.ndarray, "texels"], Float[np.ndarray, "texels 3"]]:
    """Rasterise triangles: the texels covered and, row by row, their triangle and barycentric coordinates."""
    width, height = size
    owner = np.full((height, width), -1)
    barycentric = np.zeros((height, width, 3))
    for index, corners in enumerate(points[faces]):
        a, b, c = corners
        low = np.floor(corners.min(0)).astype(int).clip(0)
        high = np.ceil(corners.max(0)).astype(int).clip(None, size)
        twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if abs(twice) < 1e-12 or (high <= low).any():
            continue
        x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
        second = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / twice
        third = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / twice
        weights = np.stack((1 - second - third, second, third), -1)
        inside = weights.min(-1) >= -1e-9
        owner[low[1] : high[1], low[0] : high[0]][inside] = index
        barycentric[low[1] : high[1], low[0] : high[0]][inside] = weights[inside]
    covered = owner >= 0
    return covered, owner[covered], barycentric[covered]
