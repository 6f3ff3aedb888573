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
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image
from torch import Tensor

from core.detail.lookup import DetailMaps, PhotoMaps
from core.detail.progressive import render_frame
from core.editing.bounds import natural_bounds
from core.editing.size import shown_bounds
from core.edits.edit import UNIT
from core.export.dimensions import size_labels
from core.export.films import turntable
from core.export.framing import filling_frame
from core.export.variants import require_one_shape
from core.export.video_frames import over, supersampling
from core.geometry.camera import Camera
from core.geometry.pixels import to_bytes
from core.gl import baked_shader, detail_shader, ground_shader
from core.gl.baked_field import BakedField
from core.gl.baking import bake
from core.gl.offscreen import OffscreenRenderer
from core.models.model import Instance
from core.rendering.ground_shadow import GroundShadow
from core.runtime.files import atomic_file
from core.runtime.modes import isolated

MAX_BYTES = 2_000_000  # of a page: accepted by every mail service and messenger
SUFFIX = ".html"
ROOM_SUFFIX = ".room.glb"  # of the file for phones beside a page; a mesh of the same name stays
_POSTER, _ICON = 512, 64  # px
_LINK_QUALITY = 80  # of the JPEG for previews of links
_AROUND = 12  # cameras around the object, all of which see all of it
_QUALITIES = (92, 1), (85, 1), (75, 2), (60, 4), (40, 8)
"""quality of the photos' WebP, and steps to which colours of texels are rounded; tried from the best"""
_VECTOR, _DISTANCE = 127.0, 8192.0  # quantisation steps per unit: of normals, of distances in scene units
_DIALECT = """#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler3D;
precision highp usampler3D;
"""
_SHARED_TEXT = 200  # characters, from which a text that stands in the scene twice is stored once
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


@dataclass(frozen=True)
class PageExtras:
    """Further contents of a page."""

    variants: Mapping[str, Instance] = field(default_factory=dict)
    """objects of one shape by name, each with a swatch; the first is shown at first, in place of the page's object"""
    unit: str = ""  # of the dimensions around the object, of :data:`core.export.dimensions.UNITS`; "": none
    room: bool = False
    """True: phones place the object in a room. The page holds a .usdz; a .glb of the page's name is written beside it,
    which Android opens where both are on a web server."""


@isolated
def write_page(
    instance: Instance, camera: Camera, path: Path, name: str, extras: PageExtras = PageExtras()
) -> Iterator[float | None]:
    """Write the page of an object atomically; yields many times.

    Raises ``ValueError`` for another ending than .html, variants of different shapes, or a path that cannot be written.

    Args:
        camera: the initial view; its image is a square. :func:`core.export.dimensions.with_room` zooms for dimensions.
        name: of the object, shown below it and in the browser's title.
    """
    if path.suffix.lower() != SUFFIX:
        raise ValueError(f"{path.name}: a page must end in {SUFFIX}")
    variants = extras.variants or {"": instance}
    require_one_shape(variants)
    with atomic_file(path) as unfinished:
        looks = []
        camera = camera.resized(_POSTER, _POSTER)
        for label, variant in variants.items():
            baked: BakedField | None = None
            for finer in bake(variant):
                baked = finer or baked
                yield None
            assert baked is not None
            looks.append(Look(label, baked, _poster(variant, camera, baked)))
        more: dict[str, Any] = {}
        if extras.unit:
            box = shown_bounds(instance, natural_bounds(instance))
            more["dimensions"] = {"low": box.low, "high": box.high, "labels": size_labels(box, extras.unit)}
        if extras.room:
            more["room"] = yield from _room(instance, variants, path.with_name(f"{path.stem}{ROOM_SUFFIX}"))
        unfinished.write_text(page(looks, camera, name, more), encoding="utf-8")


def _room(
    instance: Instance, variants: Mapping[str, Instance], glb_path: Path
) -> Generator[float, None, dict[str, Any]]:
    """Write the file beside the page, and return the content of the page for phones."""
    from core.export.mesh import room_mesh  # imports scipy, which other pages do not need
    from core.export.mesh_formats import save_mesh
    from core.export.usdz import write_usdz

    mesh = yield from room_mesh(instance, variants)
    with atomic_file(glb_path) as unfinished:
        save_mesh(mesh, unfinished)
    file = io.BytesIO()
    write_usdz(mesh, file)
    return {"glb": glb_path.name, "usdz": _packed(np.frombuffer(file.getvalue(), np.uint8))}


class Look(NamedTuple):
    """A variant as a page shows it."""

    name: str
    baked: BakedField
    poster: UInt8[np.ndarray, "height width 4"]


def first_camera(instance: Instance, camera: Camera) -> Camera:
    """Return a square camera that sees the object as ``camera`` does, zoomed so that it stays in sight all around."""
    around = turntable(instance, camera.resized(_POSTER, _POSTER), _AROUND)
    (_, first), *_ = filling_frame(around)
    return first


def page(looks: Sequence[Look], camera: Camera, name: str, more: Mapping[str, Any] | None = None) -> str:
    """Return the text of a page with the best image quality that fits.

    Args:
        looks: variants of one shape, the one that is shown at first before the others.
        more: JSON of dimensions and of the files for phones, if the page has them.
    """
    style, drawing, controls = map(_source, ("page.css", "page_drawing.js", "page_controls.js"))
    poster = looks[0].poster
    picture = Image.fromarray(poster)
    on_white = Image.alpha_composite(Image.new("RGBA", picture.size, "white"), picture).convert("RGB")
    head = {
        "name": html.escape(name),
        "link_image": _image(on_white, _LINK_QUALITY, "JPEG"),
        "icon": _image(picture.resize((_ICON, _ICON)), _LINK_QUALITY),
        "style": style,
        "script": drawing + controls,
    }
    for quality, step in _QUALITIES:
        scene = _shared({**_scene(looks, camera, quality, step), **(more or {})})
        content = json.dumps(scene, separators=(",", ":")).replace("<", "\\u003c")
        text = Template(_source("page.html")).substitute(head, poster=_image(picture, quality), scene=content)
        if len(text.encode()) <= MAX_BYTES:
            break
    return text


def _source(name: str) -> str:
    return resources.files("core.export").joinpath(name).read_text(encoding="utf-8")


def _shared(content: Any) -> dict[str, Any]:
    """Return JSON content in which each long text is a number: variants have most of their texts in common."""
    texts: dict[str, int] = {}

    def numbered(value: Any) -> Any:
        if isinstance(value, str) and len(value) >= _SHARED_TEXT:
            return {"text": texts.setdefault(value, len(texts))}
        if isinstance(value, dict):
            return {name: numbered(entry) for name, entry in value.items()}
        return [numbered(entry) for entry in value] if isinstance(value, list | tuple) else value

    return {"scene": numbered(content), "texts": list(texts)}


def _poster(instance: Instance, camera: Camera, baked: BakedField) -> UInt8[np.ndarray, "height width 4"]:
    """Render the page's first image, transparent; by the network if the machine has no OpenGL."""
    try:
        with OffscreenRenderer((camera.width, camera.height), supersampling(camera), None) as renderer:
            return renderer.draw(baked, camera)
    except RuntimeError:
        return over(render_frame(instance, camera), None)


def _scene(looks: Sequence[Look], camera: Camera, quality: int, step: int) -> dict[str, Any]:
    """Return everything the page's script needs, as JSON."""
    view = {name: getattr(camera, name) for name in ("azimuth", "elevation", "distance")}
    baked = looks[0].baked
    colours = _swatches([look.poster for look in looks])
    texels = [_rounded(look.baked.texels, step) for look in looks]
    changes = [texels[0], *(variant - texels[0] for variant in texels[1:])]  # modulo 256; 0 where no paint is
    return {
        "camera": {**view, "focal": camera.focal / camera.height},
        "first": "Photo" if baked.detail else "Start",  # name of the first view
        "proportions": baked.proportions or UNIT,
        "distance": _packed(baked.distance),
        "variants": [
            {"name": look.name, "colour": colour, **_variant(look.baked, change, camera, quality)}
            for look, colour, change in zip(looks, colours, changes, strict=True)
        ],
        "shadow": baked.shadow and _shadow(baked.shadow),
        "ground": _program(ground_shader.VERTEX, ground_shader.FRAGMENT),
        "copy": _program(_COPY_VERTEX, _COPY_FRAGMENT),
    }


def _rounded(texels: UInt8[np.ndarray, "x y z 4"], step: int) -> UInt8[np.ndarray, "x y z 4"]:
    """Return texels with colours at multiples of a step; their density stays."""
    colours = np.minimum((texels[..., :3].astype(int) + step // 2) // step * step, 255)
    return np.concatenate((colours.astype(np.uint8), texels[..., 3:]), axis=-1)


def _variant(baked: BakedField, texels: UInt8[np.ndarray, "x y z 4"], camera: Camera, quality: int) -> dict[str, Any]:
    return {
        "uniforms": baked_shader.field_uniforms(baked),
        "channels": [_packed(channel) for channel in np.moveaxis(texels, -1, 0)],  # which compress better alone
        "detail": baked.detail and _detail(baked.detail, camera, quality),
        "program": _program(baked_shader.VERTEX, baked_shader.fragment_source(baked.detail)),
    }


def _program(vertex: str, fragment: str) -> dict[str, str]:
    sources = {"vertex": vertex, "fragment": fragment}
    return {kind: source.replace("#version 330\n", _DIALECT).strip() for kind, source in sources.items()}


def _swatches(posters: Sequence[UInt8[np.ndarray, "height width 4"]]) -> list[str]:
    """Return a colour for each variant, such as #c03028: its mean where variants differ."""
    images = np.stack(posters).astype(float)
    weights = images[..., :3].std(0).sum(-1) * (images[0, ..., 3] > 0) + 1e-6
    means = np.einsum("vyxc,yx->vc", images[..., :3], weights) / weights.sum()
    return ["#" + bytes(mean.round().astype(int).tolist()).hex() for mean in means]


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
