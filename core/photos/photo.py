"""Photos to fit: read, cut out on white, and cropped like training images."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from PIL import Image
from torch import Tensor

from core.classifiers.viewpoint import Side
from core.geometry.camera import Camera
from core.geometry.pixels import bounding_box, to_bytes
from core.geometry.pose_files import PosedImage, find_pose
from core.models.model import Model
from core.models.photo_detail import SIDE, compressed
from core.photos.decode import read_rgba
from core.photos.plain_background import NoBackgroundError
from core.photos.ranking import ObjectMask, offset_from_expected
from core.photos.segmentation import CutOut, Hints, cut_out
from core.photos.sharpness import edge_softness, measure_blur
from core.photos.view_bank import SizeRange, apparent_size, view_bank
from core.runtime.modes import isolated

DOUBTFUL_MASK = 0.5  # confidence of a mask below which people are warned
_MAX_OFFSET = 0.02  # focal lengths: an object further from its expected position was moved in its image


@dataclass(frozen=True, eq=False)
class Photo:
    """An image of an object on white. Raises ``ValueError`` for parts that do not match."""

    pixels: Float[Tensor, "height width 3"]  # 0..1
    mask: Bool[Tensor, "height width"]  # True on the object
    camera: Camera | None = None  # None: unknown
    cropped: bool = False  # moved: the image's centre is not where the camera looks
    unseen: Bool[Tensor, "height width"] | None = None
    """True on pixels beyond an image edge that truncates the object; None: no such edge"""
    scaled: bool = False  # also scaled, so that the object's size says nothing: such a crop is a zoom
    opacity: Float[Tensor, "height width"] | None = None  # 0..1, if finer than the mask
    edge_error: float = 0.0  # px, uncertainty of the mask's edges
    focal: float | None = None  # px, if the image tells; a given camera has its own
    blur: float = 0.0  # px, standard deviation of the image's blur
    fine: bytes | None = field(default=None, repr=False)
    """The same part of the image up to :data:`core.models.photo_detail.SIDE` px, encoded by
    :func:`core.models.photo_detail.compressed`: colours on white and opacity. None if no finer pixels exist."""
    mask_confidence: float = 1.0  # probability that the mask is the whole object and little else
    note: str = ""  # how an ambiguous file was read
    categories: dict[str, float] = field(default_factory=dict)
    """probability of each category that has a model; empty if unknown"""
    direction: tuple[float, float] | None = None
    """azimuth and elevation (rad) from a chair's 3D box; front and back may be confused"""
    side: Side | None = None  # of the object that it shows, as a person says

    def __post_init__(self) -> None:
        height, width = self.mask.shape
        if self.unseen is not None and (self.unseen.shape != self.mask.shape or bool((self.unseen & self.mask).any())):
            raise ValueError("the unseen pixels must fit the mask and exclude the object")
        if self.opacity is not None and self.opacity.shape != self.mask.shape:
            raise ValueError("the opacity of an image must fit its mask")
        if self.pixels.shape != (height, width, 3):
            raise ValueError(f"a {width}x{height} mask does not fit pixels of shape {tuple(self.pixels.shape)}")
        if not bool(torch.isfinite(self.pixels).all()):
            raise ValueError("an image's pixels must be finite")
        if self.camera is not None and (self.camera.width, self.camera.height) != (width, height):
            raise ValueError(f"the camera is for {self.camera.width}x{self.camera.height} px, not {width}x{height}")


@isolated
def load_photo(
    path: Path | str,
    model: Model,
    pose: Path | None = None,
    hints: Hints | None = None,
    pose_axes: str = "opencv",
) -> Photo:
    """Read an image in any common format, cut out its object and crop it for a model.

    The object is cut out by :func:`core.photos.segmentation.cut_out`. An image framed like training images stays as it
    is, since the object's size determines the distance. If only the position is off, the image is recentred. Any other
    image is cropped so that the object is centred with the usual size. Beyond an image edge that the object touches,
    pixels are unknown.

    Args:
        pose: SRN's camera-to-world matrix (16 numbers), or a transforms.json; the image is then only resized.
        hints: to the object, for an image without a plain background.
        pose_axes: of the pose, see :func:`core.geometry.pose_files.find_pose`.

    Raises ``ValueError`` naming the file for anything but an image of an object, and
    :class:`core.photos.plain_background.NoBackgroundError` if hints could help.
    """
    path = Path(path)
    posed = None if pose is None else find_pose(pose, path, pose_axes)
    cut = read_cut_out(path, hints)
    with naming(path):
        return prepare_photo(cut, model, posed)


def read_cut_out(path: Path, hints: Hints | None = None) -> CutOut:
    """Cut out the object of an image file. Raises like :func:`load_photo`."""
    with naming(path):
        return cut_out(read_rgba(path), hints)


@contextmanager
def naming(path: Path | str) -> Iterator[None]:
    """Add the name of a file or a frame to errors about an image."""
    try:
        yield
    except ValueError as error:
        kind = NoBackgroundError if isinstance(error, NoBackgroundError) else ValueError
        raise kind(str(error) if str(path) in str(error) else f"{path}: {error}") from None


def prepare_photo(cut: CutOut, model: Model, posed: PosedImage | None = None) -> Photo:
    """Prepare a cut-out at the model's size like a training image; with a pose it is only resized."""
    height, width = cut.mask.shape
    size = model.image_size
    if posed is not None:
        posed_width = max(1, round(size * width / height))
        photo = _resampled(cut, (0, 0, width, height), (posed_width, size))
        return replace(photo, camera=posed.camera(posed_width, size, model.focal))
    bank = view_bank(model)
    usual = apparent_size(bank, model)
    left, top, right, bottom = bounding_box(cut.mask)
    half = max(right - left, bottom - top) / usual.median / 2
    keeps_size = cut.focal is None and _like_training(cut, usual)
    if keeps_size:
        photo = _resampled(cut, (0, 0, width, width), (size, size))
        if offset_from_expected(bank, ObjectMask(photo.mask, model.focal)) < _MAX_OFFSET:
            return photo
        half = width / 2  # recentre only: the apparent size determines the distance
    x = (left + right) / 2
    y = (top + bottom) / 2
    square = x - half, y - half, x + half, y + half
    photo = _resampled(cut, square, (size, size))
    focal = cut.focal and cut.focal * size / (2 * half)
    unseen = _unseen(cut, square, photo.mask)
    return replace(photo, cropped=True, scaled=not keeps_size, unseen=unseen, focal=focal)


# Cropping


def _like_training(cut: CutOut, usual: SizeRange) -> bool:
    """True for a square image on white with an object of the size usual in training."""
    height, width = cut.mask.shape
    if not cut.white or width != height:
        return False
    left, top, right, bottom = bounding_box(cut.mask)
    size = max(right - left, bottom - top) / width
    return 0.6 * usual.min < size < min(1.4 * usual.max, 0.9)


def _unseen(
    cut: CutOut, box: tuple[float, float, float, float], mask: Bool[Tensor, "size size"]
) -> Bool[Tensor, "size size"] | None:
    """Return pixels of a square beyond an image edge that the object touches, which may truncate it.

    An image that the object touches on all sides was trimmed and truncates nothing.
    """
    left, top, right, bottom = bounding_box(cut.mask)
    height, width = cut.mask.shape
    touched = left == 0, top == 0, right == width, bottom == height
    if all(touched) or not any(touched):
        return None
    steps = (torch.arange(len(mask)) + 0.5) / len(mask)
    x, y = (box[axis] + steps * (box[axis + 2] - box[axis]) for axis in (0, 1))
    columns = (x < 0) & touched[0] | (x > width) & touched[2]
    rows = (y < 0) & touched[1] | (y > height) & touched[3]
    return (rows[:, None] | columns) & ~mask


def _resampled(cut: CutOut, box: tuple[float, float, float, float], size: tuple[int, int]) -> Photo:
    """Resample a part of the image and measure its blur and edge error; outside the image is white background.

    Raises ``ValueError`` if nothing of the object is left.
    """
    pixels, opacity = _resampled_pixels(cut, box, size)
    mask = opacity > 0.5
    if not bool(mask.any()):
        raise ValueError(f"the object is too thin to be seen at {size[1]} px")
    blur = measure_blur(pixels)
    edge_error = math.hypot(cut.edge_error * size[1] / (box[3] - box[1]), edge_softness(opacity, blur))
    fine = _fine_pixels(cut, box, size) if max(box[2] - box[0], box[3] - box[1]) > max(size) else None
    return Photo(
        pixels,
        mask,
        opacity=opacity,
        edge_error=edge_error,
        blur=blur,
        fine=fine,
        mask_confidence=cut.confidence,
        note=cut.note,
        categories=cut.categories,
        direction=cut.direction,
    )


def _fine_pixels(cut: CutOut, box: tuple[float, float, float, float], size: tuple[int, int]) -> bytes:
    """Encode the same part at a higher resolution."""
    scale = min(SIDE, math.ceil(max(box[2] - box[0], box[3] - box[1]))) / max(size)
    pixels, opacity = _resampled_pixels(cut, box, (max(1, round(scale * size[0])), max(1, round(scale * size[1]))))
    return compressed(to_bytes(torch.cat((pixels, opacity[..., None]), -1)))


def _resampled_pixels(
    cut: CutOut, box: tuple[float, float, float, float], size: tuple[int, int]
) -> tuple[Float[Tensor, "height width 3"], Float[Tensor, "height width"]]:
    height, width = cut.mask.shape
    if box == (0, 0, width, height) and size == (width, height):
        return torch.from_numpy(cut.pixels).clone(), torch.from_numpy(cut.opacity).clone()
    # Pillow crops within the image only, so it is padded first.
    pad = math.ceil(max(0, -box[0], -box[1], box[2] - width, box[3] - height))
    inner = (box[0] + pad, box[1] + pad, box[2] + pad, box[3] + pad)
    image = np.concatenate((1 - cut.pixels, cut.opacity[..., None]), -1)
    image = np.pad(image, ((pad, pad), (pad, pad), (0, 0)))
    resampling = Image.Resampling.HAMMING if (box[3] - box[1]) >= size[1] else Image.Resampling.BICUBIC
    channels = [Image.fromarray(image[..., i]).resize(size, resampling, box=inner) for i in range(4)]
    values = torch.from_numpy(np.stack([np.asarray(channel) for channel in channels], -1)).clamp(0, 1)
    return 1 - values[..., :3], values[..., 3]
