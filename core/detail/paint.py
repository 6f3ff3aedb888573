"""Find the texture code that gives a part of an object a chosen colour: a car's body, a chair's fabric or wood.

Points on the surface get target colours: the new colour under the existing light where the part is, their own colour
elsewhere. The search starts at the trained texture nearest to the target and continues by gradient descent.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, UInt8
from torch import Tensor
from torch.nn import functional

from core.detail.maps import UNPAINTED, compared_photos
from core.detail.progressive import Frame
from core.detail.repaint import lightness, lit_paint, replaced_share
from core.geometry.camera import Camera
from core.models.latents import Latents
from core.models.model import Instance, Model
from core.rendering.folded_field import FoldedField
from core.rendering.outline import effective_strength
from core.rendering.surface import surface_points
from core.runtime.layers import pad_rows

Rgb = tuple[float, float, float]
MATERIALS = {"fabric": "seat", "wood": "legs"}  # of chairs, by the part that surely has it; metal legs count as wood
_POINTS = 1500  # points sampled on the surface; more would change the result by less than 1/255
_TEXTURES = 500  # trained textures tried as the start
_FEW = 6  # one in six points is compared with trained textures: three times as fast, and the start is as near
_STEPS = 80  # steps of Adam
_RATE = 0.06  # learning rate of Adam, in standard deviations of the trained textures
_PRIOR = 2e-5  # weight of the squared coordinates against squared colour errors
_DARKEST, _LIGHTEST = 0.3, 1.2  # light on a point, relative to the mean of its part
_COARSE = 128  # px along an image's shorter side at which a coarse paint asks for parts: 40 ms instead of a second
_ANOTHER = 0.25  # colour difference from which a part becomes evenly coloured; below, its pattern stays


@dataclass(frozen=True)
class Paint:
    """A colour for a part. Raises ``ValueError`` for a channel out of range."""

    colour: Rgb  # sRGB, 0..1
    part: str = ""  # a part's name or one of :data:`MATERIALS`; '' is the body, or the fabric

    def __post_init__(self) -> None:
        if len(self.colour) != 3 or not all(0 <= channel <= 1 for channel in self.colour):
            raise ValueError(f"a paint has three channels from 0 to 1, got {self.colour}")


def paint(instance: Instance, request: Paint) -> Generator[None, None, Instance]:
    """Return the object repainted so that images with photo detail show the colour; unchanged if they already do.

    Yields None many times. Raises ``ValueError`` for a part that the model does not know.
    """
    surface = yield from _surface(instance, request.part)
    now = surface.now
    goal = torch.tensor(request.colour)
    colour = goal
    for _ in range(20):  # find the render's colour for which images show the goal: a contraction
        colour = (goal - surface.offset(colour)).clamp(0, 1)
    if float((colour - now).abs().max()) < 0.5 / 255:
        return instance
    light = (lightness(surface.colours.T) / lightness(now).clamp_min(0.05)).clamp(_DARKEST, _LIGHTEST)
    even = ((colour - now).norm() / _ANOTHER).clamp_max(1)
    painted = torch.lerp(surface.colours + (colour - now), colour * light[:, None].sqrt(), even)
    goals = torch.lerp(surface.colours, painted.clamp(0, 1), surface.membership[:, None])
    start = yield from _nearest_texture(instance, surface, goals)
    return (yield from _refined(surface, goals, start))


def paint_colour(instance: Instance, part: str = "") -> Generator[None, None, Rgb]:
    """Return the mean colour of a part in images, sRGB 0..1; yields None many times."""
    surface = yield from _surface(instance, part)
    red, green, blue = (surface.now + surface.offset(surface.now)).clamp(0, 1).tolist()
    return red, green, blue


def paint_parts(model: Model) -> tuple[str, ...]:
    """Return the materials and parts of a model's objects that take paint, the usual one first; none is one part."""
    names = model.part_head.names if model.part_head else ()
    return (*_materials(names), *(name for name in names if name not in UNPAINTED))


def _materials(names: tuple[str, ...]) -> dict[str, str]:
    """The materials of objects with these parts, each with the part that has it for certain."""
    return MATERIALS if set(MATERIALS.values()) <= set(names) else {}


@dataclass(frozen=True, eq=False)
class CoarsePaint:
    """The paint of a part in an image, which changes at once; its texture is found by :func:`paint`."""

    image: Float32[np.ndarray, "height width 3"]  # 0..255
    fraction: Float32[np.ndarray, "height width"]  # how much of a change of paint a pixel takes, 0..1.6
    colour: Rgb  # the present paint

    def repainted(self, colour: Rgb) -> UInt8[np.ndarray, "height width 3"]:
        """Return the image in another colour of the part."""
        change = 255 * (np.array(colour, np.float32) - np.array(self.colour, np.float32))
        return (self.image + self.fraction[..., None] * change + 0.5).clip(0, 255).astype(np.uint8)


@torch.no_grad()
def coarse_paint(instance: Instance, camera: Camera, frame: Frame, part: str = "") -> CoarsePaint:
    """Return the paint of a part in a frame of the object, seen from ``camera``; no pixel has any without a surface."""
    step = max(1, min(frame.resolution) // _COARSE)
    opaque = torch.from_numpy(frame.opacity[::step, ::step] > 0.5)
    amount = torch.zeros(opaque.shape)
    image = torch.from_numpy(frame.image).movedim(-1, 0) / 255
    paint = torch.ones(3)
    if bool(opaque.any()):
        points = frame_points(instance, camera, frame, opaque, step).to(instance.model.device)
        colours = image[:, ::step, ::step][:, opaque].T.to(instance.model.device)
        membership = _membership(instance, points, colours, part)
        amount[opaque] = membership.cpu()
        paint = _mean(colours, membership).cpu()
    around = functional.max_pool2d(amount[None], 3, 1, 1)[0]
    amount = torch.where(opaque, amount, around)[None, None]  # edges are as their neighbours
    amount = functional.interpolate(amount, frame.opacity.shape, mode="bilinear", align_corners=False)[0, 0]
    fraction = lit_paint(image, paint[:, None, None], amount * torch.from_numpy(frame.opacity))
    red, green, blue = paint.tolist()
    return CoarsePaint(frame.image.astype(np.float32), fraction.numpy(), (red, green, blue))


def frame_points(
    instance: Instance, camera: Camera, frame: Frame, mask: Bool[Tensor, "rows columns"], step: int
) -> Float[Tensor, "points 3"]:
    """Return the surface points in the pixels of a mask over every ``step``-th pixel of a frame, before stretching."""
    camera = camera.resized(*frame.resolution)
    _, origin = camera.world_to_camera(torch.device("cpu"))
    directions = camera.directions(mask.nonzero().flip(-1) * step + 0.5)
    depth = torch.from_numpy(frame.depth[::step, ::step].copy())[mask]
    return (origin + directions * depth[:, None]) / torch.tensor(instance.codes.proportions or 1.0)


@dataclass(frozen=True, eq=False)
class _Surface:
    """Points on an object's surface."""

    instance: Instance
    features: Float[Tensor, "points width"]
    direction_bias: Float[Tensor, "points width"]
    colours: Float[Tensor, "points 3"]  # in the current texture
    membership: Float[Tensor, "points"]  # of the part, 0..1
    fitted: Float[Tensor, "3"]  # mean colour of the part in the texture fitted to the photos
    matched: Float[Tensor, "3"]  # difference of the photos' colour from it

    def coloured(self, codes: Latents) -> Float[Tensor, "points 3"]:
        """Return the colours in the texture of some codes; differentiable."""
        model = self.instance.model
        return model.field.colour(self.features, self.direction_bias, model.biases(codes)[1])

    def every(self, step: int) -> "_Surface":
        """Return every ``step``-th point."""
        names = ("features", "direction_bias", "colours", "membership")
        return replace(self, **{name: getattr(self, name)[::step] for name in names})

    @property
    def now(self) -> Float[Tensor, "3"]:
        """Mean colour of the part in the current texture."""
        return _mean(self.colours, self.membership)

    def offset(self, colour: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
        """Return how much images differ from a render with this colour (:func:`core.detail.repaint.repainted`)."""
        return (1 - replaced_share(colour - self.fitted)) * self.matched


def _surface(instance: Instance, part: str) -> Generator[None, None, _Surface]:
    """Sample points on an object's surface with their membership of a part."""
    model = instance.model
    points, _ = surface_points(instance.unmoved)
    yield None
    if not len(points):
        raise ValueError("the object has no surface that takes paint")
    points = points[torch.linspace(0, len(points) - 1, min(_POINTS, len(points))).long()]
    with torch.no_grad():
        features = model.field.density(points, instance.biases[0])[1]
        towards = model.field.direction_bias(-functional.normalize(points, dim=-1))
        surface = _Surface(instance, features, towards, points, points[:, 0], torch.zeros(3), torch.zeros(3))
        colours = surface.coloured(instance.codes).clamp(0, 1)
        membership = _membership(instance.unmoved, points, colours, part)
        surface = replace(surface, colours=colours, membership=membership, fitted=_mean(colours, membership))
    if not effective_strength(instance):
        return surface
    assert instance.detail is not None
    photos = yield from compared_photos(instance)
    with torch.no_grad():
        fitted = _mean(surface.coloured(instance.detail.fitted).clamp(0, 1), membership)
        matched = torch.stack([photo.match.change(fitted) for photo in photos]).mean(0)
    return replace(surface, fitted=fitted, matched=matched)


def _mean(colours: Float[Tensor, "points 3"], weight: Float[Tensor, "points"]) -> Float[Tensor, "3"]:
    """Return the weighted mean of the lighter half: undersides and gaps are dark."""
    light = lightness(colours.T)
    order = light.argsort(descending=True)
    lit = order[weight[order].cumsum(0) <= weight.sum() / 2]
    lit = lit if len(lit) else order[:1]
    return (weight[lit, None] * colours[lit]).sum(0) / weight[lit].sum().clamp_min(1e-6)


def _membership(
    instance: Instance, points: Float[Tensor, "points 3"], colours: Float[Tensor, "points 3"], part: str
) -> Float[Tensor, "points"]:
    """Return each point's membership of a part, 0..1; for a material, by similarity to its colour."""
    head = instance.model.part_head
    if head is None:
        if part:
            raise ValueError(f"this model has no parts, so it cannot paint {part}")
        return torch.ones_like(points[:, 0])
    folded = FoldedField.of(instance)
    features = folded.density(pad_rows(points))[1][: len(points)]
    memberships = dict(zip(head.names, head(features).T, strict=True))
    materials = _materials(head.names)
    names = paint_parts(instance.model)
    part = part or names[0]
    if part in memberships:
        return memberships[part]
    if part not in materials:
        raise ValueError(f"a {instance.model.noun or 'object'} has {', '.join(names)}, but no {part}")
    (opposite,) = materials.keys() - {part}
    own_colour = _mean(colours, memberships[materials[part]])
    opposite_colour = _mean(colours, memberships[materials[opposite]])
    contrast = (own_colour - opposite_colour).norm()
    if float(contrast) < _ANOTHER / 2:  # materials of one colour are separated by parts
        return 1 - memberships["legs"] if part == "fabric" else memberships["legs"]
    nearer = (colours - opposite_colour).norm(dim=-1) - (colours - own_colour).norm(dim=-1)
    return (0.5 + 2 * nearer / contrast).clamp(0, 1)


def _nearest_texture(
    instance: Instance, surface: _Surface, goals: Float[Tensor, "points 3"]
) -> Generator[None, None, Instance]:
    """Return the object with its own texture, or with the trained one nearest to the goals."""
    model = instance.model
    valid = model.codes.valid
    tried = valid[:: max(1, len(valid) // _TEXTURES)]
    best = instance
    least = torch.inf
    sparse = surface.every(_FEW)
    for candidate in (instance, *(instance.with_texture(model[index]) for index in tried)):
        with torch.no_grad():
            error = float((sparse.coloured(candidate.codes) - goals[::_FEW]).square().mean())
        if error < least:
            best = candidate
            least = error
        yield None
    return best


def _refined(surface: _Surface, goals: Float[Tensor, "points 3"], start: Instance) -> Generator[None, None, Instance]:
    """Return the best object of a gradient descent over the texture code from ``start``; offsets stay."""
    space = start.model.codes.texture_space
    coordinates = space.coordinates(start.codes.texture).clone().requires_grad_()
    best = start
    least = torch.inf
    optimiser = torch.optim.Adam([coordinates], _RATE)
    for _ in range(_STEPS):
        with torch.enable_grad():
            texture = space.code(coordinates)
            colours = surface.coloured(start.changed(texture=texture).codes)
            loss = (colours - goals).square().mean() + _PRIOR * coordinates.square().sum()
            optimiser.zero_grad()
            loss.backward()
        if float(loss.detach()) < least:
            best = start.changed(texture=texture.detach().clone())
            least = float(loss.detach())
        optimiser.step()
        yield None
    return best
