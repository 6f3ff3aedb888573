"""Photos of a fitted object with their cameras: the source of detail beyond the codes."""

import base64
import io
import itertools
import math
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Bool, Float, Float16, UInt8
from PIL import Image, ImageDraw
from torch import Tensor

from core.geometry.camera import Camera
from core.models.latents import Latents
from core.runtime.reading import open_image, reading

SIDE = 1024  # px of the longer side at most; keeps lettering on a door legible
MAX_BYTES = 200_000  # of a photo's file in scenes, projects and images
MAX_PHOTOS = 4  # photos kept with an object: graphics cards support at least 16 textures, a photo takes three
_OVERHEAD = math.radians(65)  # elevation from which a photo shows no side
BACKGROUND = 0.1  # opacity below which a pixel certainly shows background, so that the object ends there
OtherSide = Literal["model", "mirrored"]
OTHER_SIDES: tuple[OtherSide, ...] = get_args(OtherSide)
"""Colours of surfaces that only the mirror image shows: the model's, or the photo's."""
_QUALITIES = (96, 92, 85, 75, 60, 40)  # of WebP, tried from the best


class Erasure(NamedTuple):
    """A brush stroke over a photo: the covered pixels are not used."""

    points: tuple[tuple[float, float], ...]  # fractions of the photo's width and height
    radius: float  # fraction of the photo's longer side


@dataclass(frozen=True)
class PhotoView:
    """A photo of an object and its camera. Raises ``ValueError`` for a file that is too large."""

    image: bytes = field(repr=False)
    """WebP, upright as the camera sees the object: colours on white, and the object's opacity"""
    camera: Camera  # at the size of the image
    erased: tuple[Erasure, ...] = ()
    outline_margin: float | None = None
    """focal lengths beyond the mask within which the object ends; None if the mask does not bound the object"""

    def __post_init__(self) -> None:
        if len(self.image) > MAX_BYTES:
            raise ValueError(f"photo detail has at most {MAX_BYTES / 1000:.0f} kB, got {len(self.image) / 1000:.0f}")
        numbers = [number for stroke in self.erased for number in (stroke.radius, *itertools.chain(*stroke.points))]
        if not all(math.isfinite(number) for number in numbers):
            raise ValueError("erasures of a photo must be finite")
        if self.outline_margin is not None and not 0 < self.outline_margin < math.inf:
            raise ValueError(f"the margin of a photo's outline must be positive, got {self.outline_margin}")

    @classmethod
    def of(cls, rgba: UInt8[np.ndarray, "height width 4"], camera: Camera) -> "PhotoView":
        """Compress pixels, on white with the object's opacity, to a view; scale them down if the file is too large."""
        image = compressed(rgba)
        return cls(image, camera.resized(*decompressed(image).shape[1::-1]))

    def pixels(self) -> UInt8[np.ndarray, "height width 4"]:
        """Decode colours on white and opacity.

        Raises ``ValueError`` if the file is damaged or its size differs from the camera's.
        """
        pixels = decompressed(self.image)
        if pixels.shape[1::-1] != (self.camera.width, self.camera.height):
            raise ValueError("the photo's size differs from its camera's")
        return pixels

    def kept(self, width: int, height: int) -> Bool[np.ndarray, "height width"]:
        """Return the mask of pixels that are not erased, at a size in px."""
        image = Image.new("1", (width, height), 1)
        draw = ImageDraw.Draw(image)
        for points, radius in self.erased:
            pixels = [(x * width, y * height) for x, y in points]
            reach = radius * max(width, height)
            draw.line(pixels, 0, round(2 * reach))
            for x, y in pixels:
                draw.ellipse((x - reach, y - reach, x + reach, y + reach), 0)
        return np.array(image)


@dataclass(frozen=True, eq=False)
class PhotoDetail:
    """Photos of an object and the latents fitted to them. Raises ``ValueError`` for inconsistent values."""

    views: tuple[PhotoView, ...]  # one to MAX_PHOTOS
    shape: Float[Tensor, "shape_latent"] = field(repr=False)
    texture: Float[Tensor, "texture_latent"] = field(repr=False)
    strength: float = 1.0  # how strongly the detail is shown, 0..1
    other_side: OtherSide = "mirrored"
    shape_offsets: Float16[Tensor, "rows width"] | None = field(default=None, repr=False)  # as those of Latents
    texture_offsets: Float16[Tensor, "more_rows width"] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if not 0 <= self.strength <= 1:
            raise ValueError(f"the strength of photo detail is 0 to 1, got {self.strength}")
        if self.other_side not in OTHER_SIDES:
            raise ValueError(f"the other side is one of {', '.join(OTHER_SIDES)}, got {self.other_side!r}")
        if not 1 <= len(self.views) <= MAX_PHOTOS:
            raise ValueError(f"detail is of 1 to {MAX_PHOTOS} photos, got {len(self.views)}")
        _ = self.fitted  # raises for numbers that are not finite

    @classmethod
    def of(cls, views: tuple[PhotoView, ...], fitted: Latents) -> "PhotoDetail":
        """Return photos with the latents fitted to them, kept on the processor."""
        return cls(views, **vars(fitted.detached()))

    @property
    def azimuths(self) -> tuple[float, ...]:
        """The azimuths (rad) of photos that show a side of the object."""
        return tuple(view.camera.azimuth for view in self.views if abs(view.camera.elevation) < _OVERHEAD)

    @property
    def fitted(self) -> Latents:
        """The latents fitted to the photos."""
        return Latents(self.shape, self.texture, self.shape_offsets, self.texture_offsets)

    def __eq__(self, value: object) -> bool:
        if not isinstance(value, PhotoDetail):
            return NotImplemented
        return self.key == value.key and self.strength == value.strength

    def __hash__(self) -> int:
        return hash(self.key)

    @property
    def key(self) -> tuple:
        """Everything but the strength, as a comparable key."""
        return *self.views, self.other_side, self.fitted

    def erasing(self, number: int, erased: tuple[Erasure, ...]) -> "PhotoDetail":
        """Return a copy in which the erasures of photo ``number`` are replaced."""
        views = [replace(view, erased=erased) if index == number else view for index, view in enumerate(self.views)]
        return replace(self, views=tuple(views))

    def to_json(self) -> dict:
        """Return a JSON-compatible dictionary with image files in base64; scenes read it back."""
        views = [
            {
                "image": base64.b64encode(view.image).decode(),
                "camera": {name: getattr(view.camera, name) for name in Camera.__dataclass_fields__},
                "erased": [stroke._asdict() for stroke in view.erased],
                "outline_margin": view.outline_margin,
            }
            for view in self.views
        ]
        return {
            "views": views,
            "shape": self.shape.tolist(),
            "texture": self.texture.tolist(),
            "strength": self.strength,
            "other_side": self.other_side,
        } | self.fitted.offsets_json()


def compressed(rgba: UInt8[np.ndarray, "height width 4"]) -> bytes:
    """Compress pixels to a WebP file of at most :data:`MAX_BYTES`: lower quality first, then smaller images."""
    image = Image.fromarray(rgba)
    while True:
        for quality in _QUALITIES:
            file = io.BytesIO()
            # Without `exact`, the colour under transparent pixels would not stay white.
            image.save(file, "WEBP", quality=quality, method=4, exact=True)
            if file.tell() <= MAX_BYTES:
                return file.getvalue()
        image = image.reduce(2)


def decompressed(file: bytes) -> UInt8[np.ndarray, "height width 4"]:
    """Decode a file of :func:`compressed`. Raises ``ValueError`` if it is damaged."""
    with reading("its photo", "an image"), open_image(io.BytesIO(file), limit=8 * SIDE**2) as image:
        return np.array(image.convert("RGBA"))
