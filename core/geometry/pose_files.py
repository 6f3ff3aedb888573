"""Pose files: the 16 numbers of a camera's matrix, as in ShapeNet-SRN, or ``transforms.json``, as in NeRF-synthetic."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.geometry.camera import OPENCV_FROM_OPENGL, Camera
from core.runtime.reading import field_types, optional, read_json, read_numbers, reading, typed

_HINTS = {  # error messages for poses with other axes
    "opengl": "it is a pose in OpenGL axes (--pose-axes opengl reads it)",
    "opencv": "it is a pose in OpenCV axes (--pose-axes opencv reads it)",
    "opencv inverse": "it goes from world to camera; its inverse is wanted",
    "opengl inverse": "it goes from world to camera, in OpenGL axes; its inverse is wanted",
}
_FOCALS = "camera_angle_x", "camera_angle_y", "fl_x", "fl_y"  # fields that give a focal length
_LIMITS = dict.fromkeys(_FOCALS[:2], math.pi) | dict.fromkeys((*_FOCALS[2:], "w", "h"), math.inf)
_DISTORTIONS = "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"
_MAX_DISTORTION = 1e-3  # moves the corners of an image by less than half a pixel at a model's size
_PINHOLE_MODELS = "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"  # without distortion
_TOLERANCE = 0.01  # relative to the focal length or the image: a pixel at a model's size

_RADII = 0.15, 0.55  # scene units: plausible distances of an object's outermost point from the origin
_RADIUS = 0.5  # scene units: that of a box with a diagonal of 1


class PosedImage(NamedTuple):
    """An image file with its known camera."""

    image: Path  # perhaps without its ending, in transforms.json
    pose: Float[Tensor, "4 4"]  # camera to world, OpenCV axes, float64
    focal: float | None = None  # in image widths; None: the model's
    mask: Path | None = None  # white on the object; None: none beside the image
    aspect: float | None = None  # image height in widths; None if the file gives none

    def camera(self, width: int, height: int, focal: float = 1.0) -> Camera:
        """Return the camera of an image of a size in px; ``focal`` (px) is used unless the file gives one.

        Raises ``ValueError`` for a size of other proportions than the file's.
        """
        if self.aspect and abs(self.aspect * width - height) > 1 + _TOLERANCE * height:
            sizes = f"the image's height is {height / width:.3f} of its width, but {self.aspect:.3f} by w and h"
            raise ValueError(f"{sizes} of its pose: it was cropped or turned after that")
        return Camera.from_pose(self.pose, focal if self.focal is None else self.focal * width, width, height)


@dataclass(frozen=True, kw_only=True)
class _Intrinsics:
    """JSON of a camera's lens: of a frame or, for frames without their own, of the whole file."""

    camera_angle_x: float | None = None  # rad, horizontal field of view
    camera_angle_y: float | None = None  # rad, vertical field of view
    fl_x: float | None = None  # px, instead of the angle
    w: float | None = None  # px
    fl_y: float | None = None  # px
    h: float | None = None  # px
    cx: float | None = None  # px, where the optical axis meets the image
    cy: float | None = None  # px
    k1: float = 0.0  # distortion
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    distortion_params: tuple[float, ...] = ()
    is_fisheye: bool = False
    camera_model: str = "PINHOLE"  # COLMAP's name


@dataclass(frozen=True, kw_only=True)
class _Frame(_Intrinsics):
    """JSON of a frame."""

    file_path: str
    transform_matrix: tuple[tuple[float, float, float, float], ...]  # three or four rows


def find_pose(path: Path, image: Path, axes: str = "opencv", scale: float = 1.0) -> PosedImage:
    """Return an image's camera from a pose file, or from its frame of a ``transforms.json``.

    Args:
        axes: see :func:`read_pose`; a JSON file has OpenGL's.
        scale: scene units of a unit of the file.

    Raises ``ValueError`` naming the file if it is not a pose, or no frame has the image's name.
    """
    if path.suffix.lower() != ".json":
        return PosedImage(image, scaled(read_pose(path, axes), scale))
    frames = read_transforms(path, scale)
    named = [frame for frame in frames if image.name in (frame.image.name, f"{frame.image.name}{image.suffix}")]
    same = [frame for frame in named if frame.image.with_name(image.name).resolve() == image.resolve()]
    if len(same or named) != 1:
        examples = ", ".join(frame.image.name for frame in frames[:3])
        raise ValueError(f"{path}: {len(same or named)} frames are named {image.name}; it has {examples}, …")
    return (same or named)[0]


def read_transforms(path: Path, scale: float = 1.0) -> tuple[PosedImage, ...]:
    """Read the frames of a ``transforms.json``: camera to world with OpenGL axes, z up.

    The field of view is a frame's or the file's.

    Args:
        scale: scene units of a unit of the file.

    Raises ``ValueError`` naming the file unless every camera is upright, looks at the origin, and has a lens without
    distortion whose axis meets the middle of the image.
    """
    with reading(path, "a file of poses (transforms.json)"):
        content = typed(dict, read_json(path), name="transforms")
        common = {name: content[name] for name in field_types(_Intrinsics) if content.get(name) is not None}
        if "frames" not in content:
            raise ValueError("transforms.frames is missing")
        entries = typed(tuple[dict, ...], content["frames"], name="transforms.frames")
        frames = typed(tuple[_Frame, ...], [_inherited(entry, common) for entry in entries], name="transforms.frames")
        if not frames:
            raise ValueError("it has no frames")
        return tuple(_posed_image(path.parent, frame, scale) for frame in frames)


def scaled(pose: Float[Tensor, "4 4"], scale: float) -> Float[Tensor, "4 4"]:
    """Return a pose in other units: ``scale`` of the new for one of the old."""
    factors = torch.ones(4, 4, dtype=pose.dtype)
    factors[:3, 3] = scale
    return pose * factors


def require_scale(
    masks: Sequence[Bool[np.ndarray, "height width"]], cameras: Sequence[Camera], scale: float = 1.0
) -> None:
    """Raise ``ValueError`` unless masks show an object as large as those of models, whose box has a diagonal of 1.

    Args:
        scale: already applied to the cameras; the message names a better one.
    """
    radius = max(map(_visible_radius, masks, cameras))
    if radius and not _RADII[0] <= radius <= _RADII[1]:
        better = f"{scale * _RADIUS / radius:.2g}"
        raise ValueError(
            f"with these poses the object is {2 * radius:.3g} scene units across instead of 1: --pose-scale {better}"
        )


def _visible_radius(mask: Bool[np.ndarray, "height width"], camera: Camera) -> float:
    """Return the largest distance of a mask's rays from the origin, at which the camera looks; 0 for no object."""
    rows, columns = mask.nonzero()
    if not len(rows):
        return 0.0
    offset = np.hypot(columns + 0.5 - camera.width / 2, rows + 0.5 - camera.height / 2).max()
    return camera.distance * math.sin(math.atan(float(offset) / camera.focal))


def _inherited(frame: dict[str, Any], common: dict[str, Any]) -> dict[str, Any]:
    """Return a frame's JSON with the intrinsics that it lacks; its focal length replaces the file's, in any form."""
    stated = {name: value for name, value in frame.items() if value is not None}
    if "fl_x" in stated or "camera_angle_x" in stated:
        common = {name: value for name, value in common.items() if name not in _FOCALS}
    return common | stated


def _focal(frame: _Frame) -> float:
    """Return a frame's focal length in image widths, on which all its fields must agree."""
    if not (focals := _focals(frame)):
        raise ValueError("it needs camera_angle_x (the horizontal field of view, 0 to 3.14), or fl_x and w")
    first = next(iter(focals))
    for name, focal in focals.items():
        if abs(focal / focals[first] - 1) > _TOLERANCE:
            stated = f"{name} says a focal length of {focal:.3f} image widths, but {first} {focals[first]:.3f}"
            raise ValueError(f"{frame.file_path}: {stated}")
    return focals[first]


def _focals(frame: _Frame) -> dict[str, float]:
    """Return the focal length in image widths by each field that states it."""
    sides = {"camera_angle_x": 1.0, "camera_angle_y": _aspect(frame)}
    focals = {}
    for name in ("camera_angle_x", "fl_x", "camera_angle_y", "fl_y"):
        value = getattr(frame, name)
        if value and name not in sides and not frame.w:
            raise ValueError(f"{frame.file_path}: {name} needs w, the image's width in px")
        if value and (side := sides.get(name, frame.w)):
            focals[name] = 0.5 * side / math.tan(value / 2) if name in sides else value / side
    return focals


def _aspect(frame: _Frame) -> float | None:
    """Return the image's height in widths; None if the frame does not state it."""
    if frame.w and frame.h:
        return frame.h / frame.w
    angles = frame.camera_angle_x, frame.camera_angle_y
    return math.tan(angles[1] / 2) / math.tan(angles[0] / 2) if angles[0] and angles[1] else None


def _require_pinhole(frame: _Frame) -> None:
    """Raise ``ValueError`` naming the field by which a frame's camera is no centred pinhole camera."""
    if frame.is_fisheye or frame.camera_model not in _PINHOLE_MODELS:
        model = "fisheye" if frame.is_fisheye else frame.camera_model
        raise ValueError(f"{frame.file_path}: camera_model {model} is not read: undistort the images first")
    for name, limit in _LIMITS.items():
        if (value := getattr(frame, name)) is not None and not 0 < value < limit:
            raise ValueError(f"{frame.file_path}: {name} {value:g} is not between 0 and {limit:.3g}")
    distortions = {name: getattr(frame, name) for name in _DISTORTIONS}
    distortions["distortion_params"] = max(frame.distortion_params, key=abs, default=0.0)
    for name, value in distortions.items():
        if abs(value) > _MAX_DISTORTION:
            raise ValueError(f"{frame.file_path}: {name} = {value:g} distorts: undistort the images first")
    for name, axis, side, size in (("cx", frame.cx, "w", frame.w), ("cy", frame.cy, "h", frame.h)):
        if axis is not None and not (size and abs(axis / size - 0.5) <= _TOLERANCE):
            stated = f"{name} {axis:g} is not the image's middle ({side} is {size or 'missing'})"
            raise ValueError(f"{frame.file_path}: {stated}: crop the images")


def _posed_image(folder: Path, frame: _Frame, scale: float) -> PosedImage:
    _require_pinhole(frame)
    rows = frame.transform_matrix
    if len(rows) not in (3, 4):
        raise ValueError(f"the transform_matrix of {frame.file_path} has 3 or 4 rows, got {len(rows)}")
    matrix = torch.tensor([*rows, (0, 0, 0, 1)][:4], dtype=torch.float64)
    pose = scaled(_as_opencv(matrix, "opengl"), scale)
    try:
        Camera.from_pose(pose, 1.0, 1, 1)
    except ValueError as error:
        raise ValueError(f"{frame.file_path}: {error}") from error
    image = folder / frame.file_path.replace("\\", "/")
    return PosedImage(image, pose, _focal(frame), aspect=_aspect(frame))


def read_pose(path: Path, axes: str = "opencv") -> Float[Tensor, "4 4"]:
    """Read a camera-to-world matrix with OpenCV axes, float64.

    Args:
        axes: camera axes of the file: "opencv" (x right, y down, looking along +z: ShapeNet-SRN) or "opengl" (x right,
            y up, looking along -z: Blender, NeRF's transforms.json).

    Raises ``ValueError`` naming the file unless its camera is upright and looks at the origin. The message suggests
    other axes, or the inverse, if these make the pose valid.
    """
    with reading(path, "a pose"):
        matrix = torch.tensor(read_numbers(path, 16), dtype=torch.float64).reshape(4, 4)
        pose = _as_opencv(matrix, axes)
        try:
            Camera.from_pose(pose, 1.0, 1, 1)
        except ValueError as error:
            hints = (hint for likely, hint in _HINTS.items() if likely != axes and _is_pose(matrix, likely))
            if hint := next(hints, None):
                raise ValueError(hint) from error
            raise
        return pose


def _as_opencv(matrix: Float[Tensor, "4 4"], axes: str) -> Float[Tensor, "4 4"]:
    """Convert a camera-to-world matrix to OpenCV axes; ``axes`` may end with "inverse" for world-to-camera."""
    convention, _, inverse = axes.partition(" ")
    if inverse:
        matrix = torch.linalg.inv(matrix)
    return matrix if convention == "opencv" else matrix @ torch.from_numpy(OPENCV_FROM_OPENGL)


def _is_pose(matrix: Float[Tensor, "4 4"], axes: str) -> bool:
    return optional(lambda: Camera.from_pose(_as_opencv(matrix, axes), 1.0, 1, 1)) is not None
