"""Pictures to fit: loaded, cut out on white, framed as the training pictures are."""

import math
import struct
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from PIL import Image, ImageOps
from scipy.ndimage import binary_dilation, binary_erosion, gaussian_gradient_magnitude, label
from skimage.color import rgb2lab
from torch import Tensor

from core.camera import Camera
from core.model import Model
from core.starts import Apparent, apparent

SMALLEST = 8
"""px: a picture or an object with a shorter side than this shows nothing to fit."""
MOST_PIXELS = 400_000_000
"""of a file, 20,000 x 20,000: beyond, decoding it may take more memory than a small machine has."""
_WORKING_SIDE = 1024
"""px: the longer side at which pictures are cut out"""
_ALIKE = 9.0
"""CIE76 colour distance up to which a pixel is the ground's colour; about four just noticeable differences"""
_SHADED = 30.0
"""lightness that soft light or shadow may change"""
_SMOOTH = 1000.0
"""CIE76 per length of the picture: a slope steeper than this is an edge"""


@dataclass(frozen=True, eq=False)
class Photo:
    """A picture of an object on white. Raises ``ValueError`` where its parts do not fit together."""

    pixels: Float[Tensor, "height width 3"]
    """0..1"""
    mask: Bool[Tensor, "height width"]
    """True on the object"""
    camera: Camera | None = None
    """None: find it"""
    framed: bool = False
    """The picture was moved and scaled, so distance and middle are not those of the camera that took it."""

    def __post_init__(self) -> None:
        height, width = self.mask.shape
        if self.pixels.shape != (height, width, 3):
            raise ValueError(f"a {width}x{height} mask does not fit pixels of shape {tuple(self.pixels.shape)}")
        if not bool(torch.isfinite(self.pixels).all()):
            raise ValueError("a picture's pixels must be finite")
        if self.camera is not None and (self.camera.width, self.camera.height) != (width, height):
            raise ValueError(f"the camera is for {self.camera.width}x{self.camera.height} px, not {width}x{height}")


@dataclass(frozen=True, eq=False)
class _CutOut:
    """A picture at the size it was cut out."""

    pixels: Float[np.ndarray, "height width 3"]
    """0..1, on white"""
    mask: Bool[np.ndarray, "height width"]
    white: bool
    """the ground was white or clear, as in training pictures"""


def load_photo(path: Path, model: Model, pose: Path | None = None) -> Photo:
    """Read a picture in any usual format, cut its object out and frame it for a model.

    The object is told from the ground by the alpha channel, else by a plain ground of any colour found from the
    border. A picture that looks like a training picture keeps its framing, in which the distance is written; any
    other is framed so that the object stands in the middle in the size usual in training.

    Args:
        pose: a text file with the camera-to-world matrix of SRN (16 numbers); the picture is then only resized.

    Raises ``ValueError``, one line naming the file, for anything that is no picture of an object.
    """
    try:
        matrix = None if pose is None else _read_pose(pose)
        return _photo(_decoded(path), model, matrix)
    except ValueError as error:
        named = any(str(file) in str(error) for file in (path, pose) if file is not None)
        raise ValueError(str(error) if named else f"{path}: {error}") from None


def photo_from_array(
    pixels: UInt8[np.ndarray, "height width channels"] | Float[np.ndarray, "height width channels"],
    model: Model,
    pose: Float[Tensor, "4 4"] | None = None,
) -> Photo:
    """:func:`load_photo` for pixels at hand: 3 or 4 channels, bytes or numbers in [0, 1]."""
    if pixels.ndim != 3 or pixels.shape[-1] not in (3, 4):
        raise ValueError(f"a picture has 3 or 4 channels, got an array of shape {pixels.shape}")
    if pixels.dtype != np.uint8:
        if not np.isfinite(pixels).all():
            raise ValueError("a picture's pixels must be finite")
        pixels = (np.clip(pixels, 0, 1) * 255 + 0.5).astype(np.uint8)
    return _photo(Image.fromarray(pixels).convert("RGBA"), model, pose)


def _photo(image: Image.Image, model: Model, pose: Float[Tensor, "4 4"] | None) -> Photo:
    """The whole way from an RGBA picture."""
    if min(image.size) < SMALLEST:
        raise ValueError(f"a picture of {image.width}x{image.height} px is too small; {SMALLEST} px are the least")
    cut = _cut_out(image)
    size = model.image_size
    if pose is not None:
        width = max(1, round(size * image.width / image.height))
        pixels, mask = _resampled(cut, (0, 0, image.width, image.height), (width, size))
        return Photo(pixels, mask, Camera.from_pose(pose, model.focal, width, size))
    usual = apparent(model)
    if _like_training(cut, usual):
        side = image.width
        pixels, mask = _resampled(cut, (0, 0, side, side), (size, size))
        return Photo(pixels, mask)
    pixels, mask = _resampled(cut, _frame(cut, usual), (size, size))
    return Photo(pixels, mask, framed=True)


# Reading


def _decoded(path: Path) -> Image.Image:
    """The picture upright, as RGBA with 8 bits, its longer side at most :data:`_WORKING_SIDE`."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with _opened(path) as image:
                if image.width * image.height > MOST_PIXELS:
                    size = f"{image.width}x{image.height}"
                    raise ValueError(f"the picture is too large ({size} px); make it smaller first")
                image.draft("RGB", (_WORKING_SIDE, _WORKING_SIDE))
                image.load()
                return _small_rgba(image)
    except FileNotFoundError:
        raise ValueError(f"no such picture: {path}") from None
    except MemoryError:
        raise ValueError("the picture is too large for this machine's memory") from None
    except (OSError, SyntaxError, EOFError, IndexError, TypeError, struct.error, zlib.error) as error:
        raise ValueError(f"this is not a picture that can be read ({_first_line(error)})") from None


def _opened(path: Path) -> Image.Image:
    """Opened without Pillow's own limit, for which ours stands in; only the header is read."""
    limit = Image.MAX_IMAGE_PIXELS
    try:
        Image.MAX_IMAGE_PIXELS = None
        return Image.open(path)
    except Image.UnidentifiedImageError:
        raise ValueError("this is not a picture (PNG, JPEG, WebP, ...)") from None
    finally:
        Image.MAX_IMAGE_PIXELS = limit


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def _small_rgba(image: Image.Image) -> Image.Image:
    """Upright RGBA of 8 bits, made small before it is converted, so that a huge picture costs memory once."""
    if image.mode.startswith(("I", "F")):
        image = _eight_bits(image)
    if image.mode in ("P", "1", "PA") or "transparency" in image.info:
        # A palette cannot be averaged, and opened out it takes four times the memory.
        image = _thinned(image, 4 * _WORKING_SIDE).convert("RGBA")
    factor = max(image.size) // (2 * _WORKING_SIDE)
    orientation = image.getexif()
    if factor > 1 and min(image.size) >= factor:
        image = image.reduce(factor)
        image.getexif().update(orientation)
    image = ImageOps.exif_transpose(image).convert("RGBA")
    # Pillow resizes RGBA with the colours weighted by alpha.
    return _thinned(image, _WORKING_SIDE, Image.Resampling.LANCZOS)


def _thinned(image: Image.Image, side: int, resampling: Image.Resampling = Image.Resampling.NEAREST) -> Image.Image:
    """The picture, made smaller where its longer side is larger than this."""
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


def _read_pose(path: Path) -> Float[Tensor, "4 4"]:
    try:
        numbers = [float(word) for word in path.read_text().split()]
    except (OSError, ValueError):
        raise ValueError(f"{path}: cannot be read as a pose (16 numbers)") from None
    if len(numbers) != 16:
        raise ValueError(f"{path}: a pose has 16 numbers, got {len(numbers)}")
    try:
        matrix = torch.tensor(numbers, dtype=torch.float64).reshape(4, 4)
        Camera.from_pose(matrix, 1.0, 1, 1)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return matrix


# Cutting out


def _cut_out(image: Image.Image) -> _CutOut:
    """The object by its alpha channel, else by a plain ground."""
    values = np.asarray(image, dtype=np.float32) / 255
    colours, alpha = values[..., :3], values[..., 3:]
    if (alpha < 0.5).mean() > 0.001:
        pixels, mask, white = colours * alpha + 1 - alpha, alpha[..., 0] > 0.5, True
    else:
        ground, white = _ground(colours)
        pixels, mask = colours, ~ground
    mask = _without_specks(mask)
    rows, columns = np.nonzero(mask)
    if len(rows) < 12 or max(np.ptp(rows), np.ptp(columns)) + 1 < SMALLEST / 2:
        raise ValueError("no object found: the picture shows nothing but ground")
    if mask.mean() > 0.97:
        raise ValueError(_NO_GROUND)
    # On white, half-covered pixels around the object are right as they are; on a colour they are left out.
    kept = binary_dilation(mask, iterations=2) if white else _eroded(mask)
    return _CutOut(np.where(kept[..., None], pixels, np.float32(1)), mask, white)


_NO_GROUND = "the picture has no plain ground: cut the object out first (a PNG with a clear ground), or put it on white"


def _ground(colours: Float[np.ndarray, "height width 3"]) -> tuple[Bool[np.ndarray, "height width"], bool]:
    """Where the ground is, and whether it is white. Raises ``ValueError`` where no plain ground surrounds anything.

    The ground's colour may change slowly over the picture (a lit wall). It spreads from the border over what is
    alike, and over soft light and shadow: of about the same hue, without an edge. Enclosed parts stay the object's
    unless they cannot be told from the ground (the gaps in the back of a chair).
    """
    lab = rgb2lab(colours).astype(np.float32)
    model, noise = _ground_colour(lab)
    distance = np.linalg.norm(lab - model, axis=-1)
    alike = distance < np.clip(4 * noise + 2, 2.5, _ALIKE)
    outside = _reached(alike | _shaded(lab, model))
    gaps = (distance < np.clip(2 * noise, 1.0, 3.0)) & ~outside
    pieces, count = label(gaps)
    areas = np.bincount(pieces.ravel(), minlength=count + 1)
    areas[0] = 0
    outside |= (areas > 4e-4 * outside.size)[pieces]
    lightness, chroma = model[..., 0].min(), np.abs(model[..., 1:]).max()
    return outside, bool(lightness > 96 and chroma < 3)


def _ground_colour(lab: Float[np.ndarray, "height width 3"]) -> tuple[Float[np.ndarray, "height width 3"], float]:
    """A smooth ground fitted to the border, robust to an object that touches it, and how much it wavers (CIE76)."""
    height, width = lab.shape[:2]
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j].astype(np.float32)
    terms = np.stack((np.ones_like(x), x, y, x * x, y * y, x * y), -1)
    ring = np.ones((height, width), dtype=bool)
    thick = max(1, round(0.015 * min(height, width)))
    ring[thick:-thick, thick:-thick] = False
    colours, places = lab[ring], terms[ring]
    centre = np.median(colours, axis=0)
    kept = np.linalg.norm(colours - centre, axis=1) < 3 * _ALIKE
    for count in (1, 3, 6, 6):
        if kept.sum() < 2 * count:
            raise ValueError(_NO_GROUND)
        factors = np.linalg.lstsq(places[kept, :count], colours[kept], rcond=None)[0]
        away = np.linalg.norm(colours - places[:, :count] @ factors, axis=1)
        kept = away < (2 if count == 1 else 1) * _ALIKE
    if kept.mean() < 0.6:
        raise ValueError(_NO_GROUND)
    return terms @ factors, float(np.quantile(away[kept], 0.9))


def _shaded(
    lab: Float[np.ndarray, "height width 3"], model: Float[np.ndarray, "height width 3"]
) -> Bool[np.ndarray, "height width"]:
    """Pixels that soft light or shadow on the ground may have made: of about its hue, and without an edge."""
    longer = max(lab.shape)
    if longer < 200:  # no room for soft shadows: a render
        return np.zeros(lab.shape[:2], dtype=bool)
    slope = np.linalg.norm([gaussian_gradient_magnitude(lab[..., axis], 1.0) for axis in range(3)], axis=0)
    apart, chroma = lab - model, np.linalg.norm(model[..., 1:], axis=-1)
    same_hue = np.linalg.norm(apart[..., 1:], axis=-1) < 5 + 0.5 * chroma
    return (np.abs(apart[..., 0]) < _SHADED) & same_hue & (slope < _SMOOTH / longer)


def _reached(passable: Bool[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    """What can be reached from the border over passable pixels (not diagonally)."""
    pieces, _ = label(np.pad(passable, 1, constant_values=True))
    return (pieces == pieces[0, 0])[1:-1, 1:-1]


def _without_specks(mask: Bool[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    """The largest piece and those of at least a hundredth of it."""
    pieces, count = label(mask, np.ones((3, 3)))
    areas = np.bincount(pieces.ravel(), minlength=count + 1)
    areas[0] = 0
    return (areas >= max(2, 0.01 * areas.max(initial=0)))[pieces]


def _eroded(mask: Bool[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    """Less the pixels that the object shares with the ground, where there are enough of its own."""
    return binary_erosion(mask, iterations=1, border_value=1) if min(mask.shape) >= 200 else mask


# Framing


def _box(mask: Bool[np.ndarray, "height width"]) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of the object in px; right and bottom lie just behind it."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def _like_training(cut: _CutOut, usual: Apparent) -> bool:
    """A square picture on white whose object stands where, and as large as, a training picture shows it."""
    height, width = cut.mask.shape
    if not cut.white or width != height:
        return False
    left, top, right, bottom = _box(cut.mask)
    size = max(right - left, bottom - top) / width
    aside = max(abs(left + right - width), abs(top + bottom - height)) / (2 * width)
    return 0.6 * usual.least < size < min(1.4 * usual.most, 0.9) and aside < 1.25 * usual.aside + 0.01


def _frame(cut: _CutOut, usual: Apparent) -> tuple[float, float, float, float]:
    """The square, in px of the cut-out, that shows the object in the middle and in the usual size."""
    left, top, right, bottom = _box(cut.mask)
    half = max(right - left, bottom - top) / usual.typical / 2
    across, down = (left + right) / 2, (top + bottom) / 2
    return across - half, down - half, across + half, down + half


def _resampled(
    cut: _CutOut, box: tuple[float, float, float, float], size: tuple[int, int]
) -> tuple[Float[Tensor, "height width 3"], Bool[Tensor, "height width"]]:
    """A part of the picture at a size; what lies outside the picture is white ground."""
    height, width = cut.mask.shape
    if box == (0, 0, width, height) and size == (width, height):
        return torch.from_numpy(cut.pixels).clone(), torch.from_numpy(cut.mask).clone()
    # Pillow crops within the picture only, so it is padded first.
    pad = math.ceil(max(0, -box[0], -box[1], box[2] - width, box[3] - height))
    inner = (box[0] + pad, box[1] + pad, box[2] + pad, box[3] + pad)
    whole = np.concatenate((1 - cut.pixels, cut.mask[..., None].astype(np.float32)), -1)
    whole = np.pad(whole, ((pad, pad), (pad, pad), (0, 0)))
    smooth = Image.Resampling.HAMMING if (box[3] - box[1]) >= size[1] else Image.Resampling.BICUBIC
    channels = [Image.fromarray(whole[..., i]).resize(size, smooth, box=inner) for i in range(4)]
    values = torch.from_numpy(np.stack([np.asarray(channel) for channel in channels], -1)).clamp(0, 1)
    return 1 - values[..., :3], values[..., 3] > 0.5
