"""A scene is what a person edits: which model, which codes, from where. Saved as JSON, exact to float32.

A PNG image can hold the scene that it shows: its JSON is a text of the file, so the image alone brings it back.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8
from PIL import Image, PngImagePlugin

from core.files import atomic_file
from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.model import Model

IMAGE_FORMATS = (".png", ".jpg", ".webp")
"""The endings to offer: images that nearly every program opens."""
OPAQUE_FORMATS = (".jpg", ".jpeg")
"""Those that have no transparent pixels."""
_KEY = "CodeNeRF scene"


@dataclass(frozen=True)
class Scene:
    """One state of the editor. Edits make a new one."""

    model: str
    """the fingerprint of the model whose codes these are"""
    codes: Codes
    camera: Camera

    def save(self, path: Path) -> None:
        """Write the scene as JSON, whole or not at all. Raises ``ValueError`` for a path that cannot be written."""
        with atomic_file(path) as partial:
            partial.write_text(self.to_json() + "\n")

    def to_json(self) -> str:
        """The scene as JSON text."""
        camera = {name: getattr(self.camera, name) for name in Camera.__dataclass_fields__}
        about = {
            "model": self.model,
            "camera": camera,
            "shape": self.codes.shape.tolist(),
            "texture": self.codes.texture.tolist(),
        }
        return json.dumps(about, indent=1)

    @classmethod
    def load(cls, path: Path, model: Model) -> "Scene":
        """Read a scene for a model. Raises ``ValueError`` where it is none, or one of another model."""
        try:
            return cls.from_json(path.read_text(), model)
        except OSError as error:
            raise ValueError(f"cannot read the scene {path}: {error.strerror or error}") from None
        except UnicodeDecodeError:
            raise ValueError(f"{path} is not a scene file") from None
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None

    @classmethod
    def from_json(cls, text: str, model: Model) -> "Scene":
        """Read JSON text. Raises ``ValueError`` where it is no scene, or one of another model.

        A scene of a model that this one extends becomes one of this model: it looks nearly as it did.
        """
        try:
            about = json.loads(text)
            found = str(about["model"])
            camera = Camera(**about["camera"])
            codes = Codes(torch.tensor(about["shape"]).float(), torch.tensor(about["texture"]).float())
        except (json.JSONDecodeError, KeyError, TypeError, RuntimeError):
            raise ValueError("not a scene file, or damaged") from None
        config = model.field.config
        sizes = (config.shape_latent,), (config.texture_latent,)
        if not model.shares_codes_with(found) or (codes.shape.shape, codes.texture.shape) != sizes:
            raise ValueError(
                f"the scene belongs to another model than this one of {model.category or 'unnamed things'}"
            )
        return cls(model.fingerprint, codes, camera)


def save_image(image: UInt8[np.ndarray, "height width channels"], path: Path, scene: Scene) -> None:
    """Write an image, RGB or with opacity, by the name's ending; a PNG holds model, codes and camera, exact to float32.

    Raises ``ValueError`` for an ending that no image has, or that has no opacity, or a path that cannot be written.
    """
    if path.suffix.lower() not in Image.registered_extensions():
        raise ValueError(f"cannot write {path}: an image's name ends in {', '.join(IMAGE_FORMATS)} or the like")
    if image.shape[2] == 4 and path.suffix.lower() in OPAQUE_FORMATS:
        raise ValueError(f"{path.name}: a jpg cannot have a transparent background")
    about = PngImagePlugin.PngInfo()
    about.add_text(_KEY, scene.to_json(), zip=True)
    with atomic_file(path) as partial:
        Image.fromarray(image).save(partial, pnginfo=about)  # which only a PNG takes


def embedded_scene(path: Path) -> str | None:
    """The scene's JSON that an image holds; None for any other file."""
    try:
        with path.open("rb") as file, PngImagePlugin.PngImageFile(file) as image:
            text = image.info.get(_KEY)  # ours comes before the pixels; `image.text` would decode them to look behind
    except (OSError, SyntaxError, ValueError, EOFError, MemoryError):
        return None  # no whole PNG, and so none of ours
    return None if text is None else str(text)


def open_scene(path: Path, model: Model) -> Scene:
    """Read a scene for a model from its JSON file or from an image that holds it.

    Raises ``ValueError`` where it is none, or one of another model.
    """
    text = embedded_scene(path)
    if text is None:
        return Scene.load(path, model)
    try:
        return Scene.from_json(text, model)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def scene_model(path: Path) -> str | None:
    """The fingerprint of the model that a scene, or an image that holds one, belongs to; None where it is no scene."""
    try:
        about = json.loads(embedded_scene(path) or path.read_text())
        return str(about["model"]) if {"shape", "texture", "camera"} <= about.keys() else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
