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
from core.geometry.camera import Camera, camera_directions
from core.models.latents import Latents
from core.models.model import Instance, Model
from core.rendering.folded_field import FoldedField
from core.rendering.outline import shown_share
from core.rendering.surface import surface_points
from core.runtime.layers import pad_rows

Rgb = tuple[float, float, float]
MATERIALS = {"fabric": "seat", "wood": "legs"}  # of chairs, by the part that surely has it; metal legs count as wood
_POINTS = 1500  # of the surface; more would change the result by less than 1/255
_TEXTURES = 500  # trained textures tried as the start
_FEW = 6  # every so many points are compared with these: three times as fast, and the start is as near
_STEPS, _RATE = 80, 0.06  # of Adam, in standard deviations of the trained textures
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


def paint(instance: Instance, wanted: Paint) -> Generator[None, None, Instance]:
    """Return the object repainted so that images with photo detail show the colour; unchanged if they already do.

    Yields None many times. Raises ``ValueError`` for a part that the model does not know.
    """
    surface = yield from _surface(instance, wanted.part)
    colour, now = torch.tensor(wanted.colour), surface.now
    for _ in range(20):  # find the render's colour for which images show the wanted one: a contraction
        target = torch.tensor(wanted.colour) - surface.offset(colour)
        colour = target.clamp(0, 1)
    if float((colour - now).abs().max()) < 0.5 / 255:
        return instance
    light = (lightness(surface.colours.T) / lightness(now).clamp_min(0.05)).clamp(_DARKEST, _LIGHTEST)
    even = ((colour - now).norm() / _ANOTHER).clamp_max(1)
    painted = torch.lerp(surface.colours + (colour - now), colour * light[:, None].sqrt(), even)
    goal = torch.lerp(surface.colours, painted.clamp(0, 1), surface.share[:, None])
    start = yield from _nearest_texture(instance, surface, goal)
    return (yield from _refined(surface, goal, start))


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
    fraction: Float32[np.ndarray, "height width"]  # of a change of paint that a pixel takes, 0..1.6
    colour: Rgb  # of the paint now

    def repainted(self, colour: Rgb) -> UInt8[np.ndarray, "height width 3"]:
        """Return the image in another colour of the part."""
        change = 255 * (np.array(colour, np.float32) - np.array(self.colour, np.float32))
        return (self.image + self.fraction[..., None] * change + 0.5).clip(0, 255).astype(np.uint8)


@torch.no_grad()
def coarse_paint(instance: Instance, camera: Camera, frame: Frame, part: str = "") -> CoarsePaint:
    """Return the paint of a part in a frame of the object, seen from ``camera``; no pixel has any without a surface."""
    step = max(1, min(frame.resolution) // _COARSE)
    opaque = torch.from_numpy(frame.opacity[::step, ::step] > 0.5)
    amount, image = torch.zeros(opaque.shape), torch.from_numpy(frame.image).movedim(-1, 0) / 255
    paint = torch.ones(3)
    if bool(opaque.any()):
        points = frame_points(frame, camera, opaque, step).to(instance.model.device)
        colours = image[:, ::step, ::step][:, opaque].T.to(instance.model.device)
        share = _part_share(instance, points, colours, part)
        amount[opaque], paint = share.cpu(), _mean(colours, share).cpu()
    around = functional.max_pool2d(amount[None], 3, 1, 1)[0]
    amount, size = torch.where(opaque, amount, around), frame.opacity.shape  # edges are as their neighbours
    amount = functional.interpolate(amount[None, None], size, mode="bilinear", align_corners=False)[0, 0]
    fraction = lit_paint(image, paint[:, None, None], amount * torch.from_numpy(frame.opacity))
    red, green, blue = paint.tolist()
    return CoarsePaint(frame.image.astype(np.float32), fraction.numpy(), (red, green, blue))


def frame_points(
    frame: Frame, camera: Camera, mask: Bool[Tensor, "rows columns"], step: int
) -> Float[Tensor, "points 3"]:
    """Return the surface points in the pixels of a mask over every ``step``-th pixel of a frame."""
    camera = camera.resized(*frame.resolution)
    rotation, origin = camera.world_to_camera(torch.device("cpu"))
    pixels = mask.nonzero().flip(-1) * step + 0.5
    directions = camera_directions(pixels, camera.focal, frame.resolution) @ rotation
    depth = torch.from_numpy(frame.depth[::step, ::step].copy())[mask]
    return origin + directions * depth[:, None]


@dataclass(frozen=True, eq=False)
class _Surface:
    """Points on an object's surface."""

    instance: Instance
    features: Float[Tensor, "points width"]
    direction_bias: Float[Tensor, "points width"]
    colours: Float[Tensor, "points 3"]  # in the current texture
    share: Float[Tensor, "points"]  # 0..1, membership of the part
    fitted: Float[Tensor, "3"]  # mean colour of the part in the texture fitted to the photos
    matched: Float[Tensor, "3"]  # difference of the photos' colour from it

    def coloured(self, codes: Latents) -> Float[Tensor, "points 3"]:
        """Return the colours in the texture of some codes; differentiable."""
        model = self.instance.model
        return model.field.colour(self.features, self.direction_bias, model.biases(codes)[1])

    def every(self, step: int) -> "_Surface":
        """Return every so many points."""
        features, direction_bias = self.features[::step], self.direction_bias[::step]
        colours, share = self.colours[::step], self.share[::step]
        return replace(self, features=features, direction_bias=direction_bias, colours=colours, share=share)

    @property
    def now(self) -> Float[Tensor, "3"]:
        """Mean colour of the part in the current texture."""
        return _mean(self.colours, self.share)

    def offset(self, colour: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
        """Return how much images differ from a render with this colour (:func:`core.detail.repaint.repainted`)."""
        return (1 - replaced_share(colour - self.fitted)) * self.matched


def _surface(instance: Instance, part: str) -> Generator[None, None, _Surface]:
    """Sample points on an object's surface with their membership of a part."""
    model = instance.model
    points, _ = surface_points(instance)
    yield None
    if not len(points):
        raise ValueError("the object has no surface that takes paint")
    points = points[torch.linspace(0, len(points) - 1, min(_POINTS, len(points))).long()]
    with torch.no_grad():
        features = model.field.density(points, instance.biases[0])[1]
        towards = model.field.direction_bias(-functional.normalize(points, dim=-1))
        surface = _Surface(instance, features, towards, points, points[:, 0], torch.zeros(3), torch.zeros(3))
        colours = surface.coloured(instance.codes).clamp(0, 1)
        share = _part_share(instance, points, colours, part)
        surface = replace(surface, colours=colours, share=share, fitted=_mean(colours, share))
    if not shown_share(instance):
        return surface
    assert instance.detail is not None
    photos = yield from compared_photos(instance)
    with torch.no_grad():
        fitted = _mean(surface.coloured(instance.detail.fitted).clamp(0, 1), share)
        matched = torch.stack([photo.match.change(fitted) for photo in photos]).mean(0)
    return replace(surface, fitted=fitted, matched=matched)


def _mean(colours: Float[Tensor, "points 3"], weight: Float[Tensor, "points"]) -> Float[Tensor, "3"]:
    """Return the weighted mean of the lighter half: undersides and gaps are dark."""
    light = lightness(colours.T)
    order = light.argsort(descending=True)
    lit = order[weight[order].cumsum(0) <= weight.sum() / 2]
    lit = lit if len(lit) else order[:1]
    return (weight[lit, None] * colours[lit]).sum(0) / weight[lit].sum().clamp_min(1e-6)


def _part_share(
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
    shares = dict(zip(head.names, head(features).T, strict=True))
    materials, known = _materials(head.names), paint_parts(instance.model)
    part = part or known[0]
    if part in shares:
        return shares[part]
    if part not in materials:
        raise ValueError(f"a {instance.model.noun or 'object'} has {', '.join(known)}, but no {part}")
    own, other = (
        _mean(colours, shares[seed]) for seed in (materials[part], *(materials[m] for m in materials if m != part))
    )
    nearer = (colours - other).norm(dim=-1) - (colours - own).norm(dim=-1)
    if float((own - other).norm()) < _ANOTHER / 2:  # materials of one colour are separated by parts
        return 1 - shares["legs"] if part == "fabric" else shares["legs"]
    return (0.5 + 2 * nearer / (own - other).norm()).clamp(0, 1)


def _nearest_texture(
    instance: Instance, surface: _Surface, goal: Float[Tensor, "points 3"]
) -> Generator[None, None, Instance]:
    """Return the object with its own texture, or with the trained one nearest to the goal."""
    model = instance.model
    valid = model.codes.valid
    some = valid[:: max(1, len(valid) // _TEXTURES)]
    best = instance
    least = torch.inf
    few, goal = surface.every(_FEW), goal[::_FEW]
    for candidate in (instance, *(instance.with_texture(model[index]) for index in some)):
        with torch.no_grad():
            error = float((few.coloured(candidate.codes) - goal).square().mean())
        if error < least:
            best, least = candidate, error
        yield None
    return best


def _refined(surface: _Surface, goal: Float[Tensor, "points 3"], start: Instance) -> Generator[None, None, Instance]:
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
            loss = (colours - goal).square().mean() + _PRIOR * coordinates.square().sum()
            optimiser.zero_grad()
            loss.backward()
        if float(loss.detach()) < least:
            best = start.changed(texture=texture.detach().clone())
            least = float(loss.detach())
        optimiser.step()
        yield None
    return best
