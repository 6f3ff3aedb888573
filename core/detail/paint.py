"""Give a part of an object a chosen colour: a car's body, a chair's fabric or wood.

The paint itself is exact (:mod:`core.models.paints`). Its constants are measured at points on the surface, so that
images with photo detail show the colour.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from core.detail.maps import UNPAINTED, compared_photos
from core.detail.repaint import replaced_share
from core.geometry.pixels import lightness
from core.models.model import Instance, Model
from core.models.paints import MATERIALS, MAX_PAINTS, PartPaint, Rgb, as_rgb, contrast, painted
from core.rendering.folded_field import FoldedField
from core.rendering.outline import effective_strength
from core.rendering.surface import surface_points
from core.runtime.layers import pad_rows

_POINTS = 1500  # points sampled on the surface; more would change the result by less than 1/255
_ROUNDS = 20  # of a contraction, until images show the colour
_ONE_COLOUR = 0.125  # difference of colours below which materials are distinguished by parts


@dataclass(frozen=True)
class Paint:
    """A colour for a part. Raises ``ValueError`` for a channel out of range."""

    colour: Rgb  # sRGB, 0..1
    part: str = ""  # a part's name or one of the materials; '' is the body, or the fabric

    def __post_init__(self) -> None:
        if len(self.colour) != 3 or not all(0 <= channel <= 1 for channel in self.colour):
            raise ValueError(f"a paint has three channels from 0 to 1, got {self.colour}")


def paint(instance: Instance, request: Paint) -> Generator[None, None, Instance]:
    """Return the object repainted so that images with photo detail show the colour; unchanged if they already do.

    The paint takes the place of the part's earlier one. Yields None many times. Raises ``ValueError`` for a part that
    the model does not know.
    """
    surface = yield from _surface(instance, request.part)
    goal = torch.tensor(request.colour)
    paints = instance.codes.paints
    if float((goal - surface.shown(paints)).abs().max()) < 0.5 / 255:
        return instance
    below = tuple(paint for paint in paints if paint.part != surface.own.part)[1 - MAX_PAINTS :]
    colour = goal
    for _ in range(_ROUNDS):
        paints = *below, replace(surface.own, colour=as_rgb(colour))
        colour = (colour + goal - surface.shown(paints)).clamp(0, 1)
    return instance.changed(paints=paints)


def paint_colour(instance: Instance, part: str = "") -> Generator[None, None, Rgb]:
    """Return the mean colour of a part in images, sRGB 0..1; yields None many times."""
    surface = yield from _surface(instance, part)
    return as_rgb(surface.shown(instance.codes.paints))


def paint_parts(model: Model) -> tuple[str, ...]:
    """Return the materials and parts of a model's objects that take paint, the usual one first; none is one part."""
    names = model.part_head.names if model.part_head else ()
    materials = MATERIALS if set(MATERIALS.values()) <= set(names) else ()
    return (*materials, *(name for name in names if name not in UNPAINTED))


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of an object at points on the surface."""

    features: Float[Tensor, "points width"]
    direction_bias: Float[Tensor, "points width"]
    colours: Float[Tensor, "points 3"]  # of the network
    membership: Float[Tensor, "points"]  # of the part, 0..1
    weight: Float[Tensor, "points"]  # of points in the part's mean colour
    own: PartPaint  # the part's own colour


@torch.no_grad()
def _part(instance: Instance, points: Float[Tensor, "points 3"], part: str) -> _Part:
    """Find a part or a material at points. Raises ``ValueError`` for one that the model does not know."""
    model = instance.model
    names = paint_parts(model)
    if part and not names:
        raise ValueError(f"this model has no parts, so it cannot paint {part}")
    part = part or next(iter(names), "")
    if part not in (*names, *(model.part_head.names if model.part_head else ("",))):
        raise ValueError(f"a {model.noun or 'object'} has {', '.join(names)}, but no {part}")
    folded = FoldedField.of(instance.changed(paints=()))
    features = folded.density(pad_rows(points))[1][: len(points)]
    towards = folded.direction_bias(-functional.normalize(points, dim=-1))
    colours = folded.colour(features, towards).clamp(0, 1)
    parts = model.part_head.parts(features) if model.part_head else {}
    own = PartPaint(part, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), _materials_colours(part, colours, parts))
    membership = own.membership(colours, parts)
    weight = _lit(colours, membership)
    colour = as_rgb(weight @ colours)
    return _Part(features, towards, colours, membership, weight, replace(own, colour=colour, before=colour))


def _materials_colours(
    part: str, colours: Float[Tensor, "points 3"], parts: dict[str, Float[Tensor, "points"]]
) -> tuple[Rgb, Rgb] | None:
    """Return the colours of a material and of the opposite one; None for other parts, and if they are much alike."""
    if part not in MATERIALS:
        return None
    (opposite,) = MATERIALS.keys() - {part}
    places = (parts[MATERIALS[name]] for name in (part, opposite))
    own, opposed = (as_rgb(_lit(colours, place) @ colours) for place in places)
    return (own, opposed) if contrast(own, opposed) > _ONE_COLOUR else None


@dataclass(frozen=True, eq=False)
class _Surface(_Part):
    """A part at points all over an object, with what images add to it."""

    instance: Instance
    fitted: Float[Tensor, "3"]  # mean colour of the part in the texture fitted to the photos
    matched: Float[Tensor, "3"]  # difference of the photos' colour from it

    def shown(self, paints: tuple[PartPaint, ...]) -> Float[Tensor, "3"]:
        """Return the mean colour of the part in images with paints (:func:`core.detail.repaint.repainted`)."""
        colours = painted(self.colours, self.features, self.instance.model.part_head, paints)
        render = self.weight @ colours
        return (render + (1 - replaced_share(render - self.fitted)) * self.matched).clamp(0, 1)


def _surface(instance: Instance, part: str) -> Generator[None, None, _Surface]:
    """Sample points on an object's surface with their membership of a part."""
    points, _ = surface_points(instance.unmoved)
    yield None
    if not len(points):
        raise ValueError("the object has no surface that takes paint")
    points = points[torch.linspace(0, len(points) - 1, min(_POINTS, len(points))).long()]
    located = _part(instance.unmoved, points, part)
    matched = torch.zeros(3)
    fitted = located.weight @ located.colours
    if effective_strength(instance):
        photos = yield from compared_photos(instance)
        fitted_texture = FoldedField.of(instance.unmoved.with_texture(instance.fitted))
        fitted = located.weight @ fitted_texture.colour(located.features, located.direction_bias).clamp(0, 1)
        matched = torch.stack([photo.match.change(fitted) for photo in photos]).mean(0)
    return _Surface(**vars(located), instance=instance, fitted=fitted, matched=matched)


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
