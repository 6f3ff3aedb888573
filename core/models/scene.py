"""A scene: an object and a camera. Saved as JSON, exact to float32.

A PNG image can embed the scene it shows as a text chunk, so the image alone restores the scene.
"""

import base64
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import AbstractArray, UInt8
from PIL import Image, PngImagePlugin
from torch import Tensor

from core.edits.edit import Edit
from core.edits.kinds import edits_json, read_edits
from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.latents import read_offsets
from core.models.missing import MissingInstance, adopted
from core.models.model import Instance, Model
from core.runtime.files import atomic_file
from core.runtime.pipes import refuse_pipe
from core.runtime.reading import optional, parse_json, read_text, reading, typed

IMAGE_FORMATS = (".png", ".jpg", ".webp")  # endings to offer: nearly every program opens these
OPAQUE_FORMATS = (".jpg", ".jpeg")  # formats without transparent pixels
_KEY = "CodeNeRF scene"


@dataclass(frozen=True)
class Scene:
    """The state of the editor. An edit makes a new scene."""

    instance: Instance
    camera: Camera

    @property
    def photo_camera(self) -> Camera:
        """The camera of the object's first photo; without photos, the scene's."""
        detail = self.instance.detail
        return detail.views[0].camera if detail else self.camera

    def save(self, path: Path) -> None:
        """Write the scene as JSON, atomically. Raises ``ValueError`` for a path that cannot be written."""
        with atomic_file(path, lambda partial: Scene.without_model(read_text(partial))) as partial:
            partial.write_text(self.to_json() + "\n")

    def to_json(self) -> str:
        """Return the scene as JSON text."""
        codes = self.instance.codes
        camera = {name: getattr(self.camera, name) for name in Camera.__dataclass_fields__}
        content: dict[str, object] = {
            "model": self.instance.fingerprint,
            "camera": camera,
            "shape": codes.shape.tolist(),
            "texture": codes.texture.tolist(),
            **codes.offsets_json(),
            **edits_json(codes.edits),
        }
        if codes.detail:
            content["detail"] = codes.detail.to_json()
        return json.dumps(content, indent=1)

    @classmethod
    def load(cls, path: Path, model: Model) -> "Scene":
        """Read a JSON file, or an image that embeds a scene.

        Raises ``ValueError`` if it holds no scene, or that of another model.
        """
        with reading(path, "a scene"):
            return cls.from_json(embedded_scene(path) or read_text(path), model)

    @classmethod
    def from_json(cls, text: str, model: Model) -> "Scene":
        """Parse JSON text. Raises ``ValueError`` if it is not a scene or belongs to another model.

        A scene of a model that ``model`` extends becomes a scene of ``model`` and looks nearly the same.
        """
        scene = cls.without_model(text)
        return cls(adopted(model, scene.instance), scene.camera)

    @classmethod
    def without_model(cls, text: str) -> "Scene":
        """Parse JSON text, as :meth:`from_json` does, to a scene of a :class:`core.models.missing.MissingInstance`."""
        entries = parse_json(text)
        head = typed(_Head, entries, name="scene")
        codes = typed(Codes, entries | {"edits": entries}, _reader, "scene")
        for view in codes.detail.views if codes.detail else ():
            view.pixels()  # raises if damaged
        return cls(MissingInstance(head.model, codes), head.camera)


class _Head(NamedTuple):
    """The entries of a scene's JSON that belong to no codes."""

    model: str
    camera: Camera


def _reader(kind: Any, name: str) -> Callable[[Any], Any] | None:
    """Return the reader of a type of :class:`core.models.codes.Codes` that JSON lacks, for a field of this name."""
    if kind is bytes:
        return lambda text: base64.b64decode(typed(str, text, name=name), validate=True)
    if kind == tuple[Edit, ...]:
        return read_edits
    return partial(_tensor, kind, name) if isinstance(kind, type) and issubclass(kind, AbstractArray) else None


def _tensor(kind: Any, name: str, value: Any) -> Tensor:
    """Read a code from numbers, or offsets from texts."""
    if kind.dtypes == ("float16",):
        return read_offsets(typed(tuple[str, ...], value, name=name))
    return torch.tensor(typed(tuple[float, ...], value, name=name))


def save_image(image: UInt8[np.ndarray, "height width channels"], path: Path, scene: Scene) -> None:
    """Write an RGB or RGBA image in the format of the name's ending; a PNG also embeds the scene.

    Raises ``ValueError`` for an unknown ending, opacity in a format without it, or a path that cannot be written.
    """
    if path.suffix.lower() not in Image.registered_extensions():
        raise ValueError(f"cannot write {path}: an image must end in {', '.join(IMAGE_FORMATS)} or similar")
    if image.shape[2] == 4 and path.suffix.lower() in OPAQUE_FORMATS:
        raise ValueError(f"{path.name}: a jpg cannot have a transparent background")
    text_chunk = PngImagePlugin.PngInfo()
    text_chunk.add_text(_KEY, scene.to_json(), zip=True)
    with atomic_file(path) as partial:
        Image.fromarray(image).save(partial, pnginfo=text_chunk)  # only PNG uses `pnginfo`


def embedded_scene(path: Path) -> str | None:
    """Return the JSON of the scene embedded in an image; None for any other file."""

    def read() -> object:
        refuse_pipe(path)
        with path.open("rb") as file, PngImagePlugin.PngImageFile(file) as image:
            # The scene precedes the pixels, which `image.text` would decode to reach later chunks.
            return image.info.get(_KEY)

    text = optional(read)  # a damaged PNG counts as none of ours
    return None if text is None else str(text)


def scene_model(path: Path) -> str | None:
    """Return the fingerprint of the model that a scene file or image needs; None for other files."""
    content = optional(lambda: typed(_Head, parse_json(embedded_scene(path) or read_text(path))))
    return content and content.model
