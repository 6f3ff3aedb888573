"""A web page to share: one .html with a turnable object, for any browser and without a network.

The page holds the baked field, the photos' maps and this program's shaders in the WebGL 2 dialect. Until they are
loaded, where the browser cannot draw them, and while it withholds the graphics card, an image stands in, with a
sentence that says why.

The image is also in the page's head, for previews of links and as the tab's icon. Services that fetch such images by
address only need a copy of it beside the page on the server.
"""

import base64
import html
import io
import json
import zlib
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image
from torch import Tensor

from core.detail.lookup import DetailMaps, PhotoMaps
from core.detail.progressive import render_frame
from core.edits.edit import UNIT
from core.export.films import turntable
from core.export.framing import filling_frame
from core.export.video_frames import draw_still, over
from core.geometry.camera import Camera
from core.geometry.pixels import to_bytes
from core.gl import baked_shader, detail_shader, ground_shader
from core.gl.baked_field import BakedField
from core.gl.baking import bake
from core.models.model import Instance
from core.rendering.ground_shadow import GroundShadow
from core.runtime.files import atomic_file
from core.runtime.modes import isolated

MAX_BYTES = 2_000_000  # of a page: accepted by every mail service and messenger
SUFFIX = ".html"
_POSTER, _ICON = 512, 64  # px
_LINK_QUALITY = 80  # of the JPEG for previews of links
_AROUND = 12  # cameras around the object, all of which see all of it
_QUALITIES = (92, 85, 75, 60, 40)  # of the photos' WebP, tried from the best
_VECTOR, _DISTANCE = 127.0, 8192.0  # quantisation steps per unit: of normals, of distances in scene units
_DIALECT = """#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler3D;
precision highp usampler3D;
"""
_COPY_VERTEX = """
#version 330
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0, 0.0, 1.0); }
"""
_COPY_FRAGMENT = """
#version 330
uniform sampler2D image;
out vec4 colour;
void main() { colour = texelFetch(image, ivec2(gl_FragCoord.xy), 0); }
"""


@isolated
def write_page(instance: Instance, camera: Camera, path: Path, name: str) -> Iterator[None]:
    """Write the page of an object atomically; yields None many times.

    Raises ``ValueError`` for another ending than .html, or a path that cannot be written.

    Args:
        camera: the initial view; its image is a square.
        name: of the object, shown below it and in the browser's title.
    """
    if path.suffix.lower() != SUFFIX:
        raise ValueError(f"{path.name}: a page must end in {SUFFIX}")
    with atomic_file(path) as unfinished:
        baked: BakedField | None = None
        for finer in bake(instance):
            baked = finer or baked
            yield None
        assert baked is not None
        camera = camera.resized(_POSTER, _POSTER)
        poster = _poster(instance, camera, baked)
        unfinished.write_text(page(baked, camera, poster, name), encoding="utf-8")


def first_camera(instance: Instance, camera: Camera) -> Camera:
    """Return a square camera that sees the object as ``camera`` does, zoomed so that it stays in sight all around."""
    around = turntable(instance, camera.resized(_POSTER, _POSTER), _AROUND)
    (_, first), *_ = filling_frame(around)
    return first


def page(baked: BakedField, camera: Camera, poster: UInt8[np.ndarray, "height width 4"], name: str) -> str:
    """Return the text of a page with the best image quality that fits."""
    template = Template(resources.files("core.export").joinpath("page.html").read_text(encoding="utf-8"))
    picture = Image.fromarray(poster)
    on_white = Image.alpha_composite(Image.new("RGBA", picture.size, "white"), picture).convert("RGB")
    head = {
        "name": html.escape(name),
        "link_image": _image(on_white, _LINK_QUALITY, "JPEG"),
        "icon": _image(picture.resize((_ICON, _ICON)), _LINK_QUALITY),
    }
    for quality in _QUALITIES:
        scene = json.dumps(_scene(baked, camera, quality), separators=(",", ":")).replace("<", "\\u003c")
        text = template.substitute(head, poster=_image(picture, quality), scene=scene)
        if len(text.encode()) <= MAX_BYTES:
            break
    return text


def _poster(instance: Instance, camera: Camera, baked: BakedField) -> UInt8[np.ndarray, "height width 4"]:
    """Render the page's first image, transparent; by the network if the machine has no OpenGL."""
    drawn = draw_still(baked, camera)
    return over(render_frame(instance, camera), None) if drawn is None else drawn


def _scene(baked: BakedField, camera: Camera, quality: int) -> dict[str, Any]:
    """Return everything the page's script needs, as JSON."""
    view = {name: getattr(camera, name) for name in ("azimuth", "elevation", "distance")}
    shaders = {
        "object": (baked_shader.VERTEX, baked_shader.fragment_source(baked.detail)),
        "ground": (ground_shader.VERTEX, ground_shader.FRAGMENT),
        "copy": (_COPY_VERTEX, _COPY_FRAGMENT),
    }
    return {
        "camera": {**view, "focal": camera.focal / camera.height},
        "proportions": baked.proportions or UNIT,
        "field": {
            "uniforms": baked_shader.field_uniforms(baked),
            "texels": _packed(np.moveaxis(baked.texels, -1, 0)),  # by channel, which compresses better
            "distance": _packed(baked.distance),
        },
        "detail": baked.detail and _detail(baked.detail, camera, quality),
        "shadow": baked.shadow and _shadow(baked.shadow),
        "shaders": {
            name: dict(zip(("vertex", "fragment"), map(_in_webgl, pair), strict=True)) for name, pair in shaders.items()
        },
    }


def _detail(maps: DetailMaps, camera: Camera, quality: int) -> dict[str, Any]:
    uniforms = detail_shader.uniforms(maps, camera)
    del uniforms["level"]  # depends on the page's camera
    return {
        "uniforms": {**uniforms, "strength": maps.strength},
        "photos": [_photo(photo, quality) for photo in maps.photos],
    }


def _photo(photo: PhotoMaps, quality: int) -> dict[str, Any]:
    fine = photo.fine[0].cpu()
    _, height, width = fine.shape
    mirrored: dict[str, Any] | None = None  # the same as the photo
    if photo.mirrored is not photo.fine:
        twin = photo.mirrored[0].cpu()
        mirrored = {"image": _colours(twin, quality), "weight": _packed(to_bytes(twin[3]))}
    return {
        "width": width,
        "height": height,
        "levels": len(photo.fine),
        "fineness": photo.camera.focal * height / photo.camera.height / photo.camera.distance,
        "image": _colours(fine, quality),
        "weight": _packed(to_bytes(fine[3])),
        "mirrored": mirrored,
        "surface": _planes(photo.surface, (_VECTOR, _VECTOR, _VECTOR, _DISTANCE)),
    }


def _colours(fine: Float[Tensor, "4 height width"], quality: int) -> str:
    """Encode a photo's colours as a data URL; one colour where no view uses them, which compresses to nothing."""
    colours = torch.where(fine[3] > 0, fine[:3], 0.5)
    return _image(Image.fromarray(to_bytes(colours.movedim(0, -1))), quality)


def _shadow(shadow: GroundShadow) -> dict[str, Any]:
    uniforms = {"reach": shadow.reach, "height": shadow.height}
    return {"size": shadow.darkness.shape, "darkness": _packed(shadow.darkness), "uniforms": uniforms}


def _planes(map: Float[Tensor, "channels height width"], scales: tuple[float, ...]) -> dict[str, Any]:
    """Encode channels as differences to the left neighbour: smooth maps compress to a tenth."""
    steps = (map.cpu() * torch.tensor(scales)[:, None, None]).round().to(torch.int16).numpy()
    data = np.diff(steps, axis=-1, prepend=np.int16(0)).astype("<i2")
    return {"width": map.shape[2], "height": map.shape[1], "scales": scales, "data": _packed(data)}


def _packed(array: np.ndarray) -> str:
    return base64.b64encode(zlib.compress(np.ascontiguousarray(array).tobytes(), 9)).decode()


def _image(image: Image.Image, quality: int, kind: str = "WEBP") -> str:
    """Encode an image as a data URL."""
    file = io.BytesIO()
    image.save(file, kind, quality=quality)
    return f"data:image/{kind.lower()};base64,{base64.b64encode(file.getvalue()).decode()}"


def _in_webgl(source: str) -> str:
    return source.replace("#version 330\n", _DIALECT).strip()
