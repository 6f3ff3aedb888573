"""Image files of any usual kind, as upright RGBA of 8 bits and moderate size."""

import math
import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image, ImageOps

MAX_PIXELS = 400_000_000
"""of a file, 20,000 x 20,000: beyond, decoding it may take more memory than a small machine has."""
WORKING_SIDE = 1024
"""px: the longer side at which images are cut out"""
_NARROWEST = 128
"""The longest side of an image, in its shorter ones: of a narrower one 8 px would not be left at the working size."""
_HEIF = (".heic", ".heif", ".hif")
"""what phones write"""
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".avif", *_HEIF, ".bmp", ".tif", ".tiff")
"""of the files that a dialog offers; any other format that Pillow reads is read as well"""
_FILM_DIAGONAL = math.hypot(36, 24)
"""mm"""
_LENSES = 8, 600
"""mm, the shortest and the longest focal length that is believed"""
_SENSOR_RATIOS, _SAME_RATIO = (4 / 3, 3 / 2, 16 / 9), 0.02
"""of whole photographs, longer by shorter side; and how far they may be off"""
_TRANSPOSED = (5, 6, 7, 8)
"""EXIF orientations that exchange width and height"""


def read_rgba(path: Path) -> Image.Image:
    """The image upright, as RGBA with 8 bits, its longer side at most :data:`WORKING_SIDE`.

    Raises ``ValueError`` for what is no image, or one that is too large.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with _opened(path) as image:
                if image.width * image.height > MAX_PIXELS:
                    size = f"{image.width}x{image.height}"
                    raise ValueError(f"the image is too large ({size} px); make it smaller first")
                if max(image.size) > _NARROWEST * min(image.size):
                    raise ValueError(f"the image is too narrow ({image.width} x {image.height} px)")
                image.draft("RGB", (WORKING_SIDE, WORKING_SIDE))
                image.load()
                return _small_rgba(image)
    except FileNotFoundError:
        raise ValueError(f"no such image: {path}") from None
    except IsADirectoryError:
        raise ValueError(f"{path} is a folder, not an image") from None
    except MemoryError:
        raise ValueError("the image is too large for this machine's memory") from None
    except (OSError, SyntaxError, EOFError, IndexError, TypeError, struct.error, zlib.error) as error:
        raise ValueError(f"this is not an image that can be read ({_first_line(error)})") from None


def upright_size(path: Path) -> tuple[int, int]:
    """(width, height) in px of the file's image, upright. Raises ``ValueError`` for what is no image."""
    try:
        with _opened(path) as image:
            transposed = image.getexif().get(ExifTags.Base.Orientation) in _TRANSPOSED
            return (image.height, image.width) if transposed else image.size
    except OSError as error:
        raise ValueError(f"{path}: this is not an image that can be read ({_first_line(error)})") from None


def lens_focal(image: Image.Image) -> float | None:
    """The focal length (px) that a camera wrote beside its image, as the one that gives 35 mm film the same view."""
    written = image.getexif().get_ifd(ExifTags.IFD.Exif).get(ExifTags.Base.FocalLengthIn35mmFilm)
    if not isinstance(written, int | float) or not _LENSES[0] <= written <= _LENSES[1]:
        return None
    short, long = sorted(image.size)
    if all(abs(long / short / ratio - 1) > _SAME_RATIO for ratio in _SENSOR_RATIOS):
        return None  # a part of what the camera saw, of which nobody knows how large a part
    return float(written) / _FILM_DIAGONAL * math.hypot(*image.size)


def _opened(path: Path) -> Image.Image:
    """Opened without Pillow's own limit, which ours replaces; only the header is read."""
    if path.suffix.lower() in _HEIF:
        from pillow_heif import register_heif_opener  # costs 50 ms, and few images need it

        register_heif_opener()
    limit = Image.MAX_IMAGE_PIXELS
    try:
        Image.MAX_IMAGE_PIXELS = None
        return Image.open(path)
    except Image.UnidentifiedImageError:
        raise ValueError("this is not an image (PNG, JPEG, WebP, ...)") from None
    finally:
        Image.MAX_IMAGE_PIXELS = limit


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def _small_rgba(image: Image.Image) -> Image.Image:
    """Upright RGBA of 8 bits, made small before it is converted, so that a huge image costs memory once."""
    if image.mode.startswith(("I", "F")):
        image = _eight_bits(image)
    if image.mode in ("P", "1", "PA") or "transparency" in image.info:
        # A palette cannot be averaged, and expanded it takes four times the memory.
        image = _shrunk(image, 4 * WORKING_SIDE).convert("RGBA")
    factor = max(image.size) // (2 * WORKING_SIDE)
    orientation = image.getexif()
    if factor > 1 and min(image.size) >= factor:
        image = image.reduce(factor)
        image.getexif().update(orientation)
    image = ImageOps.exif_transpose(image).convert("RGBA")
    # Pillow resizes RGBA with the colours weighted by alpha.
    return _shrunk(image, WORKING_SIDE, Image.Resampling.LANCZOS)


def _shrunk(image: Image.Image, side: int, resampling: Image.Resampling = Image.Resampling.NEAREST) -> Image.Image:
    """The image, made smaller where its longer side is larger than this."""
    scale = side / max(image.size)
    if scale >= 1:
        return image
    size = (max(1, round(image.width * scale)), max(1, round(image.height * scale)))
    return image.resize(size, resampling)


def _eight_bits(image: Image.Image) -> Image.Image:
    """Grey of 16 or 32 bits or of floating point, by the range its numbers use."""
    values = np.nan_to_num(np.asarray(image, dtype=np.float32))
    largest = float(values.max(initial=0))
    full = 1.0 if largest <= 1 and image.mode == "F" else 255.0 if largest <= 255 else 65535.0
    return Image.fromarray((np.clip(values / max(full, largest), 0, 1) * 255 + 0.5).astype(np.uint8))
