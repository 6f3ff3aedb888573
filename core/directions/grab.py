"""Effects of shape directions around a pixel: the change of its appearance, and the motion of the surface.

A few rays around the pixel are differentiated along the first shape directions. A moving image changes by minus its
gradient times the motion; the motion is the least-squares solution over rays and channels (B. Lucas and T. Kanade, "An
iterative image registration technique", IJCAI 1981).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from core.directions.words import AXES
from core.geometry.camera import Camera
from core.geometry.rays import rays_at_pixels
from core.models.model import Instance
from core.rendering.jacobian import BiasJacobians, render_with_jacobian

_SIDE_RAYS = 9  # rays along each side of a square around the pixel
_HALF_SIDE = 0.05  # half the side of that square, relative to the image's height
_SAMPLES = 96  # samples of a ray
_KEPT = 24  # samples of a ray that are differentiated
_FELT = 0.2  # effect of a direction, relative to the largest at the pixel, from which a drag may choose it
_SLOWEST = 4.0  # px per standard deviation, where hardly any motion is measured
_RIDGE = 1e-4  # squared gradient per px far below which there is no motion, as on a plain surface


class Pull(NamedTuple):
    """Effect of a shape direction around a pixel."""

    direction: int  # index into :attr:`core.models.codes.CodeSpace.basis`
    effect: float  # root mean square change of colours and opacity (0..1) per standard deviation
    motion: tuple[float, float]  # px per standard deviation, right and down

    def amount(self, drag: tuple[float, float]) -> float:
        """Return the standard deviations that best follow a drag (px right, px down); 0 without motion.

        Example:
            >>> Pull(0, 0.3, (0.0, -20.0)).amount((5.0, -10.0))
            0.5
        """
        square = sum(component**2 for component in self.motion)
        return sum(a * b for a, b in zip(self.motion, drag, strict=True)) / square if square > 1e-6 else 0.0


@torch.no_grad()
def pulls_at(instance: Instance, camera: Camera, point: tuple[float, float], count: int = 6) -> list[Pull]:
    """Return the effects of the first shape directions around an image point, the largest first.

    Args:
        point: px right and down from the image's top left corner.
        count: number of directions.

    Empty if the square around the point (a tenth of the image's height) shows no object.
    """
    model = instance.model
    codes = instance.codes
    basis = model.codes.shape_space.basis[:count].to(model.device)
    step = 2 * _HALF_SIDE * camera.height / (_SIDE_RAYS - 1)
    along = (torch.arange(_SIDE_RAYS, device=model.device) - (_SIDE_RAYS - 1) / 2) * step
    down, right = torch.meshgrid(along, along, indexing="ij")
    pixels = torch.stack((right, down), -1).flatten(0, 1) + torch.tensor(point, device=model.device)
    rays = rays_at_pixels(pixels - model.pixel_offset, camera, model.extent_tensor)[None, None]
    shape = codes.shape.to(model.device)[None]
    texture = codes.texture.to(model.device)[None]
    shape_bias, texture_bias = instance.biases
    dtype = model.field.density_layer.weight.dtype
    moves = BiasJacobians(
        model.field.shape_bias_jacobian(shape, basis).to(dtype),
        model.field.texture_bias_jacobian(texture, torch.zeros(0, texture.shape[1], device=model.device)).to(dtype),
    )
    rendered = render_with_jacobian(model, rays, _SAMPLES, _KEPT, shape_bias[None], texture_bias[None], moves)
    if float(rendered.channels[..., 3].max()) < 0.5:
        return []
    changes = rendered.codes[0, 0].unflatten(0, (_SIDE_RAYS, _SIDE_RAYS))
    effects = changes.square().mean((0, 1, 2)).sqrt().tolist()
    motions = image_motion(rendered.channels[0, 0].unflatten(0, (_SIDE_RAYS, _SIDE_RAYS)), changes, step).tolist()
    pulls = [Pull(index, effect, (x, y)) for index, (effect, (x, y)) in enumerate(zip(effects, motions, strict=True))]
    return sorted(pulls, key=lambda pull: -pull.effect)


def dragged_pull(
    pulls: Sequence[Pull], words: Sequence[str], camera: Camera, point: tuple[float, float], drag: tuple[float, float]
) -> Pull:
    """Return the pull whose word names the axis of a drag, such as *taller* for one upwards; else the largest.

    Args:
        pulls: from :func:`pulls_at`, not empty.
        words: of the shape directions (:func:`core.directions.words.direction_words`).
        point: px, where the drag began. Sizes grow when it moves away from the object's middle.
        drag: px, right and down.
    """
    middle, *ends = camera.project(torch.cat((torch.zeros(1, 3), 0.1 * torch.eye(3)))).tolist()
    axes = [(end[0] - middle[0], end[1] - middle[1]) for end in ends]
    along = max(range(3), key=lambda axis: abs(axes[axis][0] * drag[0] + axes[axis][1] * drag[1]))
    right, down = axes[along]
    outside = math.copysign(1.0, right * (point[0] - middle[0]) + down * (point[1] - middle[1]))
    for pull in pulls:
        axis, sign = AXES.get(words[pull.direction] if pull.direction < len(words) else "", (None, 0))
        if axis == along and pull.effect >= _FELT * pulls[0].effect:
            speed = sign * outside * max(math.hypot(*pull.motion), _SLOWEST) / math.hypot(right, down)
            return pull._replace(motion=(speed * right, speed * down))
    return pulls[0]


def image_motion(
    image: Float[Tensor, "h w channels"], changes: Float[Tensor, "h w channels numbers"], step: float
) -> Float[Tensor, "numbers 2"]:
    """Return the motions (px right, px down) that best explain changes of an image.

    Args:
        changes: of the image per unit of each number, such as a coordinate of a code.
        step: px between neighbouring rows and columns.
    """
    down, right = torch.gradient(image, spacing=step, dim=(0, 1))
    slopes = torch.stack((right, down), -1).flatten(0, 2)
    normal = slopes.T @ slopes + _RIDGE * torch.eye(2, device=slopes.device)
    return torch.linalg.solve(normal, -slopes.T @ changes.flatten(0, 2)).T
