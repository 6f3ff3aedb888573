"""The surface in a render: its normals, its colours in any texture, and the parts of the model there."""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from core.detail.filters import blurred, continued
from core.geometry.rays import Rays
from core.models.model import Instance
from core.rendering.folded_field import FoldedField
from core.rendering.reference import Rendered
from core.runtime.pool import map_pieces

SOLID = 0.9  # opacity from which a pixel has the object's colour, with little background mixed in
_BLOCK = 4096  # points that a thread evaluates at a time


class SurfaceTexels(NamedTuple):
    """The opaque pixels of a render, with everything a texture needs to colour their surface."""

    pixel: Bool[Tensor, "h w"]
    features: Float[Tensor, "pixels width"]
    directions: Float[Tensor, "pixels 3"]  # unit viewing directions

    def colours(self, instance: Instance) -> Float[Tensor, "3 h w"]:
        """Return the colours of the surface in an object's texture, extrapolated beyond the opaque pixels."""
        folded = FoldedField.of(instance)
        image = torch.zeros(3, *self.pixel.shape)
        blocks = zip(self.features.split(_BLOCK), self.directions.split(_BLOCK), strict=True)
        colours = map_pieces(lambda block: folded.colour(block[0], folded.direction_bias(block[1])), blocks)
        image[:, self.pixel] = torch.cat(list(colours)).cpu().clamp(0, 1).T
        return continued(image, self.pixel)


def surface_texels(
    instance: Instance, rays: Rays, source: Rendered
) -> tuple[SurfaceTexels, dict[str, Float[Tensor, "h w"]]]:
    """Return the rendered surface and the probability of each of the model's parts there."""
    pixel = source.opacity > SOLID
    folded = FoldedField.of(instance)
    points = (rays.origins + rays.directions * source.depth[..., None])[pixel].to(folded.device)
    blocks = list(map_pieces(lambda block: folded.density(block)[1], points.split(_BLOCK)))
    features = torch.cat(blocks) if blocks else torch.zeros(0, instance.model.field.config.width)
    texels = SurfaceTexels(pixel, features, rays.directions[pixel].to(folded.device))
    parts = dict[str, Tensor]()
    if head := instance.model.part_head:
        for name, probability in head.parts(features).items():
            parts[name] = torch.zeros(pixel.shape)
            parts[name][pixel] = probability.cpu()
    return texels, parts


def surface_normals(rays: Rays, rendered: Rendered) -> Float[Tensor, "h w 3"]:
    """Return unit normals towards the camera, from slightly smoothed depth."""
    opacity = rendered.opacity.clamp_min(1e-6)
    depth = blurred((rendered.depth * opacity)[None], 1.5)[0] / blurred(opacity[None], 1.5)[0].clamp_min(1e-6)
    points = rays.origins + rays.directions * depth[..., None]
    padded = functional.pad(points.movedim(-1, 0)[None], (1,) * 4, mode="replicate")[0]
    sideways = padded[:, 1:-1, 2:] - padded[:, 1:-1, :-2]
    down = padded[:, 2:, 1:-1] - padded[:, :-2, 1:-1]
    normal = functional.normalize(torch.linalg.cross(sideways, down, dim=0).movedim(0, -1), dim=-1)
    return torch.where((normal * rays.directions).sum(-1, keepdim=True) > 0, -normal, normal)


def surface_colours(source: Rendered) -> Float[Tensor, "3 h w"]:
    """Return the render without the background's light, extrapolated beyond the outline."""
    light = (1 - source.opacity)[..., None]
    surface = ((source.colour - light) / (1 - light).clamp_min(1e-3)).clamp(0, 1).movedim(-1, 0)
    return continued(surface, source.opacity > SOLID)
