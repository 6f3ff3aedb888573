"""The orbit camera of the paper (section 3.2): azimuth, elevation and distance, always looking at the origin.

Axes, pixel centres and projection are defined here and nowhere else. The world is that of ShapeNet-SRN: z up, an
object's front at +y (azimuth 90 degrees). Camera axes are x right, y up, looking along -z, as in the paper's R. Pose
files (``pose/*.txt``) hold camera-to-world matrices with OpenCV axes: x right, y down, looking along +z. Image points
are (x, y) in px from the top left corner, x right, y down; pixel (0, 0) has its centre at (0.5, 0.5).
"""

import math
from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from core.runtime.modes import usual_settings
from core.runtime.numbers import whole

FRONT_AZIMUTH = math.pi / 2  # rad, of a camera that sees an object's front
WORLD_FROM_GLTF = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
"""World axes from glTF's (y up, front at +z). A rotation: row vectors times this matrix go from world to glTF."""
MAX_SIDE = 16_384  # px: largest side that most OpenGL drivers support; limits the area to its square
Factors = tuple[float, float, float]  # of lengths along x, y, z
OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""Converts OpenCV's camera axes (x right, y down, looking along +z) to OpenGL's, which are ours, and back."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera on an orbit: looks at the origin, z up. Raises ``ValueError`` for impossible values."""

    azimuth: float  # rad, from +x towards +y; the front of an object is seen from pi / 2.
    elevation: float  # rad above the horizontal plane, within [-pi / 2, pi / 2].
    distance: float  # scene units from the origin; an object's bounding box has a diagonal of 1.
    focal: float  # px, at this width and height.
    width: int
    height: int

    def __post_init__(self) -> None:
        for field in fields(Camera):
            if not math.isfinite(getattr(self, field.name)):
                raise ValueError(f"camera {field.name} must be finite, got {getattr(self, field.name)}")
            if field.type is int:
                object.__setattr__(self, field.name, whole(getattr(self, field.name), f"camera {field.name}"))
        if abs(self.elevation) > math.pi / 2 + 1e-6:
            raise ValueError(f"camera elevation must lie within 90 degrees, got {math.degrees(self.elevation):.2f}")
        if self.distance <= 0 or self.focal <= 0:
            raise ValueError(f"camera distance and focal must be positive, got {self.distance} and {self.focal}")
        if min(self.width, self.height) < 1 or self.width * self.height > MAX_SIDE**2:
            raise ValueError(f"camera size must be 1 to {MAX_SIDE} px a side, got {self.width}x{self.height}")

    def resized(self, width: int, height: int) -> "Camera":
        """Return the camera at another image size (px) with the same vertical field of view."""
        return replace(self, focal=self.focal * height / self.height, width=width, height=height)

    def world_to_camera(self, device: torch.device) -> tuple[Float[Tensor, "3 3"], Float[Tensor, "3"]]:
        """Return the world-to-camera rotation and the position in the world, the paper's R and p.

        They are cached: do not modify them.
        """
        return _world_to_camera(self, device)

    def to_camera_axes(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Return world points in the camera's axes: x right, y up, z negative in front."""
        rotation, origin = self.world_to_camera(points.device)
        return (points - origin) @ rotation.T

    def directions(self, pixels: Float[Tensor, "*batch 2"]) -> Float[Tensor, "*batch 3"]:
        """Return the unit directions in the world of the rays through image points."""
        rotation, _ = self.world_to_camera(pixels.device)
        return camera_directions(pixels, self.focal, (self.width, self.height)) @ rotation

    def project(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 2"]:
        """Return the image points of world points in front of the camera.

        Example:
            >>> Camera(0.3, 0.4, 1.3, 131.25, 128, 96).project(torch.zeros(3)).round().tolist()
            [64.0, 48.0]
        """
        return project(self.to_camera_axes(points), self.focal, (self.width, self.height))

    def clip_from_world(self, near: float, far: float) -> Float[np.ndarray, "4 4"]:
        """Return the float32 matrix from world to OpenGL's clip space.

        Clip coordinates x (right), y (up) and z run from -1 to 1; z from depth ``near`` to ``far``, scene units.
        """
        projection = np.zeros((4, 4))
        projection[0, 0] = 2 * self.focal / self.width
        projection[1, 1] = 2 * self.focal / self.height
        projection[2, 2:] = (far + near) / (near - far), 2 * far * near / (near - far)
        projection[3, 2] = -1.0
        camera_to_world = self.pose().numpy() @ OPENCV_FROM_OPENGL
        return (projection @ np.linalg.inv(camera_to_world)).astype(np.float32)

    def pose(self) -> Float[Tensor, "4 4"]:
        """Return the camera-to-world matrix with OpenCV axes in float64, as in SRN's pose files."""
        angles = torch.tensor([self.azimuth, self.elevation, self.distance], dtype=torch.float64)
        matrix = torch.eye(4, dtype=torch.float64)
        rotation = camera_rotation(angles[0], angles[1])
        matrix[:3, :3] = rotation.T
        matrix[:3, 3] = angles[2] * rotation[2]
        return matrix @ torch.from_numpy(OPENCV_FROM_OPENGL)

    def lengths_to(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Return the distances of points along the camera's rays, scene units."""
        return self.to_camera_axes(points).norm(dim=-1)

    def seen_lengths(self, lengths: Float[Tensor, "height width"]) -> Float[Tensor, "height width"]:
        """Return lengths along the rays of pixels as the camera sees them, scene units."""
        return lengths

    @property
    def magnification(self) -> float:
        """Largest factor between lengths that the camera sees and lengths of its points."""
        return 1.0

    def stretched(self, factors: Factors | None) -> "Camera":
        """Return the camera as seen from a space that is stretched along the axes when the camera looks at it."""
        if factors is None:
            return self
        return StretchedCamera(**vars(self), factors=factors)

    @classmethod
    def from_pose(cls, pose: Float[Tensor, "4 4"], focal: float, width: int, height: int) -> "Camera":
        """Return the orbit camera at a camera-to-world matrix with OpenCV axes.

        Raises ``ValueError`` unless the pose is upright and looks at the origin.

        Example:
            >>> camera = Camera(0.3, 0.4, 1.3, 131.25, 128, 128)
            >>> round(Camera.from_pose(camera.pose(), 131.25, 128, 128).azimuth, 6)
            0.3
        """
        matrix = pose.double()
        if matrix.shape != (4, 4) or not bool(torch.isfinite(matrix).all()):
            raise ValueError("a pose must be 4x4 finite numbers")
        x, y, z = (float(value) for value in matrix[:3, 3])
        distance = math.sqrt(x * x + y * y + z * z)
        if distance < 1e-6:
            raise ValueError("the camera of a pose must not be at the origin")
        # At the pole the position has no azimuth; the camera's right axis (-sin, cos, 0) still does.
        azimuth = math.atan2(-float(matrix[0, 0]), float(matrix[1, 0]))
        camera = cls(azimuth, math.asin(max(-1.0, min(1.0, z / distance))), distance, focal, width, height)
        error = float((camera.pose() - matrix).abs().max())
        if error > 2e-2:
            raise ValueError(f"the pose does not look at the origin with z up (off by {error:.3f})")
        return camera


@dataclass(frozen=True)
class StretchedCamera(Camera):
    """A camera that sees space stretched along the axes, with points and rays of the space before.

    Rays stay straight. Only angles and lengths change, so directions are normalised anew.

    Example:
        >>> camera, point = Camera(0.3, 0.4, 1.3, 131.25, 128, 96), torch.tensor([0.1, 0.2, 0.3])
        >>> stretched = camera.stretched((1.0, 0.5, 2.0))
        >>> torch.allclose(stretched.project(point), camera.project(torch.tensor([0.1, 0.1, 0.6])))
        True
    """

    factors: Factors = (1.0, 1.0, 1.0)

    @property
    def magnification(self) -> float:
        """The largest of the three factors."""
        return max(self.factors)

    def world_to_camera(self, device: torch.device) -> tuple[Float[Tensor, "3 3"], Float[Tensor, "3"]]:
        """Return the matrix from the space before to camera axes, no rotation, and the camera's place there."""
        rotation, origin = super().world_to_camera(device)
        factors = origin.new_tensor(self.factors)
        return rotation * factors, origin / factors

    def directions(self, pixels: Float[Tensor, "*batch 2"]) -> Float[Tensor, "*batch 3"]:
        """Return the unit directions of rays in the space before."""
        rotation, _ = super().world_to_camera(pixels.device)
        directions = camera_directions(pixels, self.focal, (self.width, self.height)) @ rotation
        return torch.nn.functional.normalize(directions / directions.new_tensor(self.factors), dim=-1)

    def lengths_to(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Return the distances in the space before."""
        _, origin = self.world_to_camera(points.device)
        return (points - origin).norm(dim=-1)

    def seen_lengths(self, lengths: Float[Tensor, "height width"]) -> Float[Tensor, "height width"]:
        """Return the lengths in the stretched space."""
        directions = self.directions(pixel_centres(self.width, self.height, lengths.device))
        return lengths * (directions * directions.new_tensor(self.factors)).norm(dim=-1)

    def pose(self) -> Float[Tensor, "4 4"]:
        """Return the matrix from camera axes to the space before, no rigid motion."""
        matrix = super().pose()
        matrix[:3] /= matrix.new_tensor(self.factors)[:, None]
        return matrix


@lru_cache(maxsize=8)
def _world_to_camera(camera: Camera, device: torch.device) -> tuple[Tensor, Tensor]:
    with usual_settings():  # cached, and a later caller may differentiate
        azimuth, elevation = torch.tensor([camera.azimuth, camera.elevation], device=device)
        rotation = camera_rotation(azimuth, elevation)
        return rotation, camera.distance * rotation[2]


def camera_rotation(
    azimuth: Float[Tensor, "*batch"], elevation: Float[Tensor, "*batch"]
) -> Float[Tensor, "*batch 3 3"]:
    """Return the world-to-camera rotation, the paper's R: its rows are the camera's right, up and backward axes."""
    sin_a, sin_e = (angle.sin() for angle in (azimuth, elevation))
    cos_a, cos_e = (angle.cos() for angle in (azimuth, elevation))
    right = -sin_a, cos_a, torch.zeros_like(sin_a)
    up = -sin_e * cos_a, -sin_e * sin_a, cos_e
    backward = cos_e * cos_a, cos_e * sin_a, sin_e
    return torch.stack((*right, *up, *backward), -1).unflatten(-1, (3, 3))


def project(
    points: Float[Tensor, "*batch 3"], focal: float | Float[Tensor, "*#batch"], size: tuple[int, int]
) -> Float[Tensor, "*batch 2"]:
    """Project points in camera axes, all in front of the camera, to image points.

    With focal 1 and size (0, 0) the result is in focal lengths from the image's middle.
    """
    scale = focal / -points[..., 2]
    return torch.stack((size[0] / 2 + points[..., 0] * scale, size[1] / 2 - points[..., 1] * scale), -1)


def camera_directions(
    pixels: Float[Tensor, "*batch 2"], focal: float | Float[Tensor, "*#batch"], size: tuple[int, int]
) -> Float[Tensor, "*batch 3"]:
    """Return unit directions in camera axes through image points, the inverse of :func:`project`."""
    right = (pixels[..., 0] - size[0] / 2) / focal
    down = (pixels[..., 1] - size[1] / 2) / focal
    directions = torch.stack(torch.broadcast_tensors(right, -down, -torch.ones_like(right)), -1)
    return torch.nn.functional.normalize(directions, dim=-1)


def pixel_centres(width: int, height: int, device: torch.device | None = None) -> Float[Tensor, "height width 2"]:
    """Return the image points of every pixel's centre."""
    y, x = torch.meshgrid(
        torch.arange(height, device=device) + 0.5, torch.arange(width, device=device) + 0.5, indexing="ij"
    )
    return torch.stack((x, y), -1)
