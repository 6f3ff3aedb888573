"""What a photo shows of an object beyond its codes, as a value: the photo itself, and from where it was taken."""

import base64
import io
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image
from torch import Tensor

from core.geometry.camera import Camera
from core.runtime.reading import open_image, reading

SIDE = 1024
"""px of the longer side at most: lettering on a door is still read"""
MAX_BYTES = 200_000
"""of the file, in scenes, projects and pictures"""
_QUALITIES = (96, 92, 85, 75, 60, 40)
"""of WebP, from the best to what any photo needs at most"""


@dataclass(frozen=True, eq=False)
class PhotoDetail:
    """A photo of an object, and the codes that were fitted to it. Raises ``ValueError`` where it cannot be one."""

    image: bytes = field(repr=False)
    """a WebP file: the object on white, how much of each pixel is its as opacity; as the camera sees it, upright"""
    camera: Camera
    """at the size of the image"""
    shape: Float[Tensor, "shape_latent"] = field(repr=False)
    texture: Float[Tensor, "texture_latent"] = field(repr=False)
    confidence: float = 1.0
    """the probability that the camera is right, 0..1"""
    strength: float = 1.0
    """how much of it is shown, 0..1"""

    def __post_init__(self) -> None:
        if not (0 <= self.confidence <= 1 and 0 <= self.strength <= 1):
            raise ValueError(f"confidence and strength are 0 to 1, got {self.confidence} and {self.strength}")
        if len(self.image) > MAX_BYTES:
            raise ValueError(
                f"a photo's detail has at most {MAX_BYTES / 1000:.0f} kB, got {len(self.image) / 1000:.0f}"
            )
        if not bool(torch.isfinite(self.shape).all() and torch.isfinite(self.texture).all()):
            raise ValueError("codes must be finite")

    @classmethod
    def of(
        cls,
        rgba: UInt8[np.ndarray, "height width 4"],
        camera: Camera,
        shape: Float[Tensor, "shape_latent"],
        texture: Float[Tensor, "texture_latent"],
        confidence: float = 1.0,
    ) -> "PhotoDetail":
        """Of pixels on white with the object's opacity; compressed, and where that is too large, made smaller."""
        image = _compressed(rgba)
        if len(image) > MAX_BYTES:
            small = Image.fromarray(rgba).reduce(2)
            return cls.of(np.array(small), camera.resized(*small.size), shape, texture, confidence)
        return cls(image, camera, shape, texture, confidence)

    def pixels(self) -> UInt8[np.ndarray, "height width 4"]:
        """Colours on white and opacity. Raises ``ValueError`` for a damaged file, or one not of the camera's size."""
        most = 8 * SIDE**2
        with reading("its photo", "an image"), open_image(io.BytesIO(self.image), most=most) as image:
            if image.size != (self.camera.width, self.camera.height):
                raise ValueError("the photo has another size than its camera")
            return np.array(image.convert("RGBA"))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, PhotoDetail):
            return NotImplemented
        return self.key == other.key and self.strength == other.strength

    def __hash__(self) -> int:
        return hash(self.key)

    @property
    def key(self) -> tuple:
        """All but the strength, to be compared."""
        codes = tuple(self.shape.tolist()), tuple(self.texture.tolist())
        return (self.image, self.camera, self.confidence, *codes)

    def to_json(self) -> dict:
        """As JSON; the file in base64."""
        return {
            "image": base64.b64encode(self.image).decode(),
            "camera": {name: getattr(self.camera, name) for name in Camera.__dataclass_fields__},
            "shape": self.shape.tolist(),
            "texture": self.texture.tolist(),
            "confidence": self.confidence,
            "strength": self.strength,
        }


def _compressed(rgba: UInt8[np.ndarray, "height width 4"]) -> bytes:
    """As good as fits."""
    for quality in _QUALITIES:
        file = io.BytesIO()
        # Without `exact`, what is under transparent pixels would not stay white.
        Image.fromarray(rgba).save(file, "WEBP", quality=quality, method=4, exact=True)
        if file.tell() <= MAX_BYTES:
            break
    return file.getvalue()
