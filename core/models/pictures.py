"""Images that hold the scene they show: its JSON is a text of the PNG, so the image alone brings it back."""

from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image, PngImagePlugin

from core.files import atomic_file
from core.models.model import Model
from core.models.scene import Scene

IMAGE_FORMATS = (".png", ".jpg", ".webp")
"""The endings to offer: images that nearly every program opens."""
_KEY = "CodeNeRF scene"


def save_image(image: UInt8[np.ndarray, "height width 3"], path: Path, scene: Scene) -> None:
    """Write an image by the name's ending; a PNG holds model, codes and camera, exact to float32.

    Raises ``ValueError`` for an ending that no image has, or a path that cannot be written.
    """
    if path.suffix.lower() not in Image.registered_extensions():
        raise ValueError(f"cannot write {path}: an image's name ends in {', '.join(IMAGE_FORMATS)} or the like")
    about = PngImagePlugin.PngInfo()
    about.add_text(_KEY, scene.to_json(), zip=True)
    with atomic_file(path) as partial:
        Image.fromarray(image).save(partial, pnginfo=about)  # which only a PNG takes


def embedded_scene(path: Path) -> str | None:
    """The scene's JSON that an image holds; None for any other file."""
    try:
        with path.open("rb") as file, PngImagePlugin.PngImageFile(file) as image:
            text = image.info.get(_KEY)  # ours stands before the pixels; `image.text` would decode them to look behind
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
