"""Image files of any common format, as upright 8-bit RGBA of moderate size."""

import io
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image, ImageCms, ImageOps

from core.photos.colour_encoding import colour_encoding, decoded
from core.runtime.raw_previews import RAW_SIZE
from core.runtime.reading import open_image, optional, reading

WORKING_SIDE = 1024  # px: longer side at which images are cut out
_NARROWEST = 128  # largest aspect ratio; beyond, the shorter side would be under 8 px at the working size
IMAGE_SUFFIXES = (
    *(".png", ".jpg", ".jpeg", ".webp", ".avif", ".heic", ".heif", ".hif", ".bmp", ".tif", ".tiff", ".gif"),
    *(".dng", ".nef", ".arw", ".cr2"),  # camera raws, which hold a JPEG
)  # offered by file dialogs
_FILM_DIAGONAL = math.hypot(36, 24)  # mm
_LENSES = 8, 600  # mm, plausible focal lengths
_SENSOR_RATIOS = (4 / 3, 3 / 2, 16 / 9)  # longer by shorter side of uncropped photographs
_SAME_RATIO = 0.02  # relative tolerance of these ratios
NOTE = "note"  # in ``Image.info``: how an ambiguous file was read
_TRANSPOSED = (5, 6, 7, 8)  # EXIF orientations that exchange width and height
_GREY = 127  # largest value of a mask's background
_DARK = 32  # a grey value closer to 0 or 255 counts as black or white
_MOST_GREY = 0.25  # largest fraction of other pixels, which soft edges have; photographs have more
_BLACK = (0, 0, 0)
_WHITE = (255, 255, 255)
_VOID = (224, 224, 192)  # colour of Pascal VOC's index 255: edges of objects
_LISTED = 8  # values in a message
_OTHER_COLOUR_SPACES = ("L", "CMYK")  # modes with colour profiles of their own


def image_files(folder: Path) -> list[Path]:
    """Return the images in a folder, sorted by name; none if there is no folder."""
    return sorted(path for path in folder.glob("*") if path.suffix.lower() in IMAGE_SUFFIXES and not is_junk(path))


def is_junk(path: Path) -> bool:
    """True for files that systems leave in copied or zipped folders: ``._000000.png``, ``__MACOSX``."""
    return path.name.startswith(".") or path.name == "__MACOSX"


def read_rgba(path: Path) -> Image.Image:
    """Read an image upright, in sRGB, as 8-bit RGBA, its longer side at most :data:`WORKING_SIDE`.

    Reads the largest page of a TIFF, and the first frame of an animation, as ``info[NOTE]`` tells.
    Raises ``ValueError`` naming the file if it is not an image, or too large.
    """
    with reading(path, "an image"), open_image(path, WORKING_SIDE) as image:
        if max(image.size) > _NARROWEST * min(image.size):
            raise ValueError(f"the image is too narrow ({image.width} x {image.height} px)")
        page = image.tell() + 1
        count = getattr(image, "n_frames", 1)
        raw = image.info.get(RAW_SIZE)
        rgba = _small_rgba(image)
        if raw:
            sizes = f"{image.width}x{image.height} px of {raw[0]}x{raw[1]}"
            rgba.info[NOTE] = f"only the preview of this camera raw is read ({sizes}): export it as JPEG"
        elif count > 1:
            rgba.info[NOTE] = f"image {page} of the {count} in this file is used"
        return rgba


def on_white(image: Image.Image) -> Image.Image:
    """Composite an image over white, as RGB."""
    return Image.alpha_composite(Image.new("RGBA", image.size, "white"), image.convert("RGBA")).convert("RGB")


def read_mask(path: Path, photo: Path, size: tuple[int, int]) -> Image.Image:
    """Read a photo's mask from an image that is white on the object, or transparent elsewhere.

    Of two values of any kind, such as 0 and 1, the brighter one is the object; of two colours of a palette, as in
    Pascal VOC, the one that is not black, or white, or else has the higher index. A mask drawn on the pixels of a photo
    before its rotation by 90 degrees is rotated, too, as ``info[NOTE]`` tells.

    Args:
        size: of the result in px, upright.

    Raises ``ValueError`` naming the file if it is not an image, has other proportions than the photo, more than two
    classes, or no object or no background.
    """
    with reading(path, "an image"), open_image(path, WORKING_SIDE) as image:
        mask = _turned(_shrunk(_mask_values(image), WORKING_SIDE, Image.Resampling.BOX), _orientation(image))
    note = ""
    drawn, upright = (upright_size(file) for file in (path, photo))
    if not _same_proportions(drawn, upright):
        with open_image(photo) as image:
            orientation = _orientation(image)
        if orientation not in _TRANSPOSED or not _same_proportions(drawn[::-1], upright):
            sizes = f"a mask of {drawn[0]}x{drawn[1]} px does not fit a photo of {upright[0]}x{upright[1]} px"
            raise ValueError(f"{path}: {sizes}")
        mask = _turned(mask, orientation)
        note = f"{path.name} is turned as {photo.name} is: it was drawn on pixels that are not upright"
    mask = mask.resize(size, Image.Resampling.BILINEAR)
    mask.info = {NOTE: note}
    return mask


def _mask_values(image: Image.Image) -> Image.Image:
    """Return grey values of a mask, white on the object, from any image."""
    transparent = "transparency" in image.info
    if image.mode == "P" and not transparent:
        colours = _palette(image)
        # Not if all colours in use are grey: programs that save small files write soft masks so.
        if any(len(set(colour)) > 1 for colour in colours.values()):
            return _object_of_palette(image, colours)
    if transparent or "A" in image.getbands():
        alpha = image.convert("RGBA").getchannel("A")
        image = alpha if np.asarray(alpha).min() < 255 else image
    grey = _eight_bits(image) if image.mode.startswith(("I", "F")) else image.convert("L")
    values = [value for value, pixels in enumerate(grey.histogram()) if pixels]
    if len(values) == 2:
        return grey.point(lambda value: 255 * (value == values[1]))
    if len(values) == 1 or values[-1] <= _GREY or values[0] > _GREY:
        raise ValueError(f"the mask has {_listed('value', values)}; it must be white on the object, black elsewhere")
    grey_fraction = sum(grey.histogram()[_DARK:-_DARK]) / (grey.width * grey.height)
    if grey_fraction > _MOST_GREY:
        raise ValueError(f"this is no mask: {grey_fraction:.0%} of its pixels are neither black nor white")
    return grey


def _palette(image: Image.Image) -> dict[int, tuple[int, ...]]:
    """Return the colour of each index in use, without Pascal VOC's colour of pixels of unknown class."""
    colours = np.array(image.getpalette("RGB")).reshape(-1, 3).tolist()
    used = [index for index, pixels in enumerate(image.histogram()) if pixels]
    return {index: tuple(colours[index]) for index in used if index < len(colours) and tuple(colours[index]) != _VOID}


def _object_of_palette(image: Image.Image, colours: dict[int, tuple[int, ...]]) -> Image.Image:
    """Return a mask of the object's index, grey on pixels of unknown class."""
    if len(colours) != 2:
        raise ValueError(f"the mask has {_listed('palette index', list(colours))}; it must have the object's and 0")
    background, target = sorted(colours, key=lambda index: (colours[index] == _WHITE, colours[index] != _BLACK, index))
    return image.point(lambda index: 0 if index == background else 255 if index == target else _GREY, "L")


def _listed(name: str, values: Sequence[int]) -> str:
    """Count and list values, at most eight of them.

    Example:
        >>> _listed("palette index", [0, 7, 15])
        '3 palette indices (0, 7, 15)'
    """
    plural = name.replace("index", "indices") if "index" in name else f"{name}s"
    listed = ", ".join(map(str, values[:_LISTED]))
    return f"{len(values)} {plural if len(values) != 1 else name} ({listed}{', …' if len(values) > _LISTED else ''})"


def upright_size(path: Path) -> tuple[int, int]:
    """Return (width, height) in px of a file's upright image. Raises ``ValueError`` naming a file that is no image."""
    with reading(path, "an image"), open_image(path) as image:
        is_lying = image.format != "TIFF" and _orientation(image) in _TRANSPOSED  # Pillow turns a TIFF itself
        return (image.height, image.width) if is_lying else image.size


def _orientation(image: Image.Image) -> int:
    """Return the EXIF orientation; 1 (upright) if there is none."""
    return int(_exif(image).get(ExifTags.Base.Orientation, 1))


def _same_proportions(first: tuple[int, int], second: tuple[int, int]) -> bool:
    """True if two sizes differ only in scale, up to a px of rounding."""
    return abs(first[0] * second[1] - first[1] * second[0]) <= max(*first, *second)


def lens_focal(image: Image.Image) -> float | None:
    """Return the focal length in px from an image's EXIF, which gives it as 35 mm equivalent; None if unknown."""
    details = optional(lambda: _exif(image).get_ifd(ExifTags.IFD.Exif)) or {}
    millimetres = details.get(ExifTags.Base.FocalLengthIn35mmFilm)
    if not isinstance(millimetres, int | float) or not _LENSES[0] <= millimetres <= _LENSES[1]:
        return None
    short, long = sorted(image.size)
    if all(abs(long / short / ratio - 1) > _SAME_RATIO for ratio in _SENSOR_RATIOS):
        return None  # a crop of unknown extent
    return float(millimetres) / _FILM_DIAGONAL * math.hypot(*image.size)


def _exif(image: Image.Image) -> Image.Exif:
    """Return the EXIF data; empty if unreadable."""
    return optional(image.getexif) or Image.Exif()


def _small_rgba(image: Image.Image) -> Image.Image:
    """Convert to upright 8-bit RGBA, shrinking before the conversion to save memory."""
    encoding = colour_encoding(image)
    profile = None if encoding else image.info.get("icc_profile")
    exif = _exif(image)
    if image.mode.startswith(("I", "F")):
        image = _eight_bits(_shrunk(image, 4 * WORKING_SIDE))
    if image.mode in ("P", "1", "PA") or "transparency" in image.info:
        # A palette cannot be averaged, and takes four times the memory expanded.
        image = _shrunk(image, 4 * WORKING_SIDE).convert("RGBA")
    factor = max(image.size) // (2 * WORKING_SIDE)
    if factor > 1 and min(image.size) >= factor:
        image = image.reduce(factor)
    if image.mode in _OTHER_COLOUR_SPACES:
        image = _in_srgb(image, profile)
    # Pillow resizes RGBA with the colours weighted by alpha.
    image = _in_srgb(_shrunk(image.convert("RGBA"), WORKING_SIDE, Image.Resampling.LANCZOS), profile)
    image = decoded(image, encoding) if encoding else image
    image = _turned(image, exif.pop(ExifTags.Base.Orientation, 1))
    exif_bytes = optional(exif.tobytes)
    image.info = {"exif": exif_bytes} if exif_bytes else {}
    return image


def _turned(image: Image.Image, orientation: int) -> Image.Image:
    """Return an image turned upright by an EXIF orientation, without metadata."""
    image.info = {}
    image.getexif()[ExifTags.Base.Orientation] = orientation
    return ImageOps.exif_transpose(image).copy()  # a copy reads new metadata, the transposed image would not


def _in_srgb(image: Image.Image, profile: bytes | None) -> Image.Image:
    """Convert colours of another space, such as the Display P3 of phones, to sRGB.

    Unchanged if the profile is broken or of another kind of image.
    """
    if not profile or b"sRGB" in profile[:1024]:
        return image
    mode = "RGBA" if image.mode == "RGBA" else "RGB"
    source = optional(lambda: ImageCms.ImageCmsProfile(io.BytesIO(profile)))
    srgb = ImageCms.createProfile("sRGB")
    return optional(lambda: ImageCms.profileToProfile(image, source, srgb, outputMode=mode)) or image


def _shrunk(image: Image.Image, side: int, resampling: Image.Resampling = Image.Resampling.NEAREST) -> Image.Image:
    """Shrink an image whose longer side exceeds ``side``."""
    scale = side / max(image.size)
    if scale >= 1:
        return image
    size = (max(1, round(image.width * scale)), max(1, round(image.height * scale)))
    return image.resize(size, resampling)


def _eight_bits(image: Image.Image) -> Image.Image:
    """Convert grey of 16 or 32 bits or floating point to 8 bits. White is 1, 255 or else the largest value."""
    values = np.nan_to_num(np.asarray(image, dtype=np.float32))
    largest = float(values.max(initial=0))
    white = next((white for white in (1.0, 255.0) if largest <= white), largest)
    return Image.fromarray((np.clip(values / white, 0, 1) * 255 + 0.5).astype(np.uint8))
