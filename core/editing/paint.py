"""Give a part of an object a chosen colour: a car's body, a chair's fabric or wood.

The paint itself is exact (:mod:`core.edits.paint`). Its constants are measured at points on the surface, so that
images with photo detail show the colour.
"""

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, UInt8
from torch import Tensor
from torch.nn import functional

from core.detail.maps import compared_photos
from core.detail.progressive import Frame
from core.detail.repaint import lit_paint, replaced_share
from core.edits import kinds
from core.edits.paint import MATERIALS, UNPAINTED, PartPaint, Rgb, as_rgb
from core.geometry.camera import Camera
from core.geometry.pixels import lightness
from core.models.model import Instance, Model
from core.rendering.folded_field import FoldedField
from core.rendering.outline import effective_strength
from core.rendering.surface import surface_points
from core.runtime.layers import pad_rows

_POINTS = 1500  # points sampled on the surface; more would change the result by less than 1/255
_COARSE = 128  # px along an image's shorter side at which a coarse paint asks for parts: 40 ms instead of a second
_ROUNDS = 20  # of a contraction, until images show the colour
_ONE_COLOUR = 0.125  # difference of colours below which materials are distinguished by parts


@dataclass(frozen=True)
class Paint:
    """A colour for a part. Raises ``ValueError`` for a channel out of range."""

    colour: Rgb  # sRGB, 0..1
    part: str = ""  # a part's name or one of the materials; '' is the part with the largest surface

    def __post_init__(self) -> None:
        if len(self.colour) != 3 or not all(0 <= channel <= 1 for channel in self.colour):
            raise ValueError(f"a paint has three channels from 0 to 1, got {self.colour}")


def paint(instance: Instance, request: Paint) -> Generator[None, None, Instance]:
    """Return the object repainted so that images with photo detail show the colour; unchanged if they already do.

    The paint takes the place of the part's earlier one. Yields None many times. Raises ``ValueError`` for a part that
    the model does not know.
    """
    own_paint, mean_colour = yield from _surface(instance, request.part)
    goal = torch.tensor(request.colour)
    paints = instance.codes.of_kind(PartPaint)
    if float((goal - mean_colour(paints)).abs().max()) < 0.5 / 255:
        return instance
    below = tuple(paint for paint in paints if paint.part != own_paint.part)[1 - PartPaint.most :]
    colour = goal
    for _ in range(_ROUNDS):
        paints = *below, replace(own_paint, colour=as_rgb(colour))
        colour = (colour + goal - mean_colour(paints)).clamp(0, 1)
    return instance.with_edits(PartPaint, *paints)


def paint_colour(instance: Instance, part: str = "") -> Generator[None, None, Rgb]:
    """Return the mean colour of a part in images, sRGB 0..1; yields None many times."""
    _, mean_colour = yield from _surface(instance, part)
    return as_rgb(mean_colour(instance.codes.of_kind(PartPaint)))


def paint_parts(model: Model) -> tuple[str, ...]:
    """Return the parts and materials of a model's objects that take paint; none is one part."""
    names = model.part_head.names if model.part_head else ()
    materials = MATERIALS if set(MATERIALS.values()) <= set(names) else ()
    return (*(name for name in names if name not in UNPAINTED), *materials)


@dataclass(frozen=True, eq=False)
class CoarsePaint:
    """The paint of a part in an image, which changes at once; :func:`paint` gives it to the object."""

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
    part = _checked(instance.model, part)
    step = max(1, min(frame.resolution) // _COARSE)
    opaque = torch.from_numpy(frame.opacity[::step, ::step] > 0.5)
    amount = torch.zeros(opaque.shape)
    image = torch.from_numpy(frame.image).movedim(-1, 0) / 255
    present = torch.ones(3)
    if bool(opaque.any()):
        points = frame_points(instance, camera, frame, opaque, step).to(instance.model.device)
        colours = image[:, ::step, ::step][:, opaque].T.to(instance.model.device)
        features = FoldedField.of(instance).density(pad_rows(points))[1][: len(points)]
        weight, located = _located(instance.model, part, colours, features)
        parts = instance.model.part_head.parts(features) if instance.model.part_head else {}
        amount[opaque] = located.membership(colours, parts).cpu()
        present = (weight @ colours).cpu()
    around = functional.max_pool2d(amount[None], 3, 1, 1)[0]
    amount = torch.where(opaque, amount, around)[None, None]  # edges are as their neighbours
    amount = functional.interpolate(amount, frame.opacity.shape, mode="bilinear", align_corners=False)[0, 0]
    fraction = lit_paint(image, present[:, None, None], amount * torch.from_numpy(frame.opacity))
    return CoarsePaint(frame.image.astype(np.float32), fraction.numpy(), as_rgb(present))


def frame_points(
    instance: Instance, camera: Camera, frame: Frame, mask: Bool[Tensor, "rows columns"], step: int
) -> Float[Tensor, "points 3"]:
    """Return the surface points in the pixels of a mask over every ``step``-th pixel of a frame, before stretching."""
    camera = camera.resized(*frame.resolution)
    _, origin = camera.world_to_camera(torch.device("cpu"))
    directions = camera.directions(mask.nonzero().flip(-1) * step + 0.5)
    depth = torch.from_numpy(frame.depth[::step, ::step].copy())[mask]
    return (origin + directions * depth[:, None]) / torch.tensor(instance.codes.proportions or 1.0)


@torch.no_grad()
def _surface(
    instance: Instance, part: str
) -> Generator[None, None, tuple[PartPaint, Callable[[tuple[PartPaint, ...]], Float[Tensor, "3"]]]]:
    """Find a part at points all over an object. Return a paint of its own colour, and the colour that images show.

    That is a function of paints (:func:`core.detail.repaint.repainted`): the mean colour of the part.
    """
    part = _checked(instance.model, part)
    network = instance.unmoved.unpainted
    points, _ = surface_points(network)
    yield None
    if not len(points):
        raise ValueError("the object has no surface that takes paint")
    points = points[torch.linspace(0, len(points) - 1, min(_POINTS, len(points))).long()]
    folded = FoldedField.of(network)
    features = folded.density(pad_rows(points))[1][: len(points)]
    towards = folded.direction_bias(-functional.normalize(points, dim=-1))
    colours = folded.colour(features, towards).clamp(0, 1)
    weight, located = _located(instance.model, part, colours, features)
    fitted = (weight @ colours).cpu()  # mean colour of the part in the texture fitted to the photos
    matched = torch.zeros(3)  # difference of the photos' colour from it
    if effective_strength(instance):
        photos = yield from compared_photos(instance)
        fitted = (weight @ FoldedField.of(network.with_texture(instance.fitted)).colour(features, towards)).cpu()
        matched = torch.stack([photo.match.change(fitted) for photo in photos]).mean(0)

    def shown(paints: tuple[PartPaint, ...]) -> Float[Tensor, "3"]:
        head = instance.model.part_head
        render = (weight @ kinds.colours(colours, paints, lambda: head.parts(features) if head else {})).cpu()
        return (render + (1 - replaced_share(render - fitted)) * matched).clamp(0, 1)

    return located, shown


def _checked(model: Model, part: str) -> str:
    """Return a part, or "" for the largest one. Raises ``ValueError`` for one that the model does not know."""
    names = paint_parts(model)
    if part and not names:
        raise ValueError(f"this model has no parts, so it cannot paint {part}")
    if part and part not in names and not (model.part_head and part in model.part_head.names):
        raise ValueError(f"a {model.noun or 'object'} has {', '.join(names)}, but no {part}")
    return part


def _located(
    model: Model, part: str, colours: Float[Tensor, "points 3"], features: Float[Tensor, "points width"]
) -> tuple[Float[Tensor, "points"], PartPaint]:
    """Return the weight of points in a part's mean colour, and a paint of this colour; "" is the largest part."""
    parts = model.part_head.parts(features) if model.part_head else {}
    if not part:
        names = (name for name in parts if name not in UNPAINTED)
        part = max(names, key=lambda name: float(parts[name].sum()), default="")
    materials = None
    if part in MATERIALS:
        (opposite,) = MATERIALS.keys() - {part}
        memberships = (parts[MATERIALS[name]] for name in (part, opposite))
        material, opposed = (as_rgb(_lit(colours, membership) @ colours) for membership in memberships)
        materials = (material, opposed) if math.dist(material, opposed) > _ONE_COLOUR else None
    black = PartPaint(part, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), materials)
    weight = _lit(colours, black.membership(colours, parts))
    colour = as_rgb(weight @ colours)
    return weight, replace(black, colour=colour, before=colour)


def _lit(colours: Float[Tensor, "points 3"], membership: Float[Tensor, "points"]) -> Float[Tensor, "points"]:
    """Return weights, of sum 1, of a part's lighter half: without undersides, gaps and edges to other parts."""
    certain = (2 * membership - 1).clamp_min(0)
    weight = certain if certain.any() else membership
    order = lightness(colours.T).argsort(descending=True)
    lit = order[weight[order].cumsum(0) <= weight.sum() / 2]
    weights = torch.zeros_like(weight)
    weights[lit] = weight[lit]
    weights[order[:1]] += 1e-6
    return weights / weights.sum()
