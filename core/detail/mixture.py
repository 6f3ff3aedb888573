"""The paint of an object's parts in a photo: a mixture of colours.

A part shows its paint in several lights, and other things: lamps, lettering, trim, wood beside cloth. Its colours are a
mixture of Gaussians, and the render says how probable each part is at a pixel. The paint of a part is its largest
Gaussian and those of the same paint in another light. Its share of a pixel is their posterior probability, so paint
ends at the photo's edges.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.detail.filters import blurred, enlarged, resized
from core.detail.lookup import smooth_step
from core.detail.repaint import chroma, same_paint
from core.edits.paint import MATERIALS

_GAUSSIANS = 3  # of a part
_ROUNDS = 15  # of expectation maximisation
_HUE_NOISE, _LIGHT_NOISE = 0.02, 0.06  # sRGB, least standard deviation of a Gaussian's channels alone, and together
_SAMPLES = 4000  # pixels to which a mixture is fitted, at most twice as many
_BLUR = 2.5  # px, standard deviation: error of the parts' edges in the render
_TRUST = 3.0  # exponent of the parts' probabilities, which colours alone would override
_EVEN = 0.8  # least share of a pixel of paint alone
_VIVID = 0.05, 0.15  # chroma of a paint that no pane reflects, from the second
_ONE_COLOUR = 0.125  # difference of colours below which materials are distinguished by parts
_BLOCK = 65536  # pixels evaluated at a time


class PhotoPaints(NamedTuple):
    """The paints of an object's parts and materials in a photo."""

    names: tuple[str, ...]
    colours: Float[Tensor, "names 3"]  # sRGB, mean
    shares: Float[Tensor, "names height width"]  # of pixels, 0..1, in half precision

    def on_body(self, like: Float[Tensor, "h w"]) -> Bool[Tensor, "h w"]:
        """Mark the pixels that are nearly all paint of the first part, such as a car's body, in another size."""
        return resized(self.shares[:1].float(), like)[0] > _EVEN


def photo_paints(
    photo: Float[Tensor, "3 height width"], parts: Mapping[str, Float[Tensor, "h w"]], weight: Float[Tensor, "h w"]
) -> PhotoPaints:
    """Find the paints of parts in a photo.

    Args:
        parts: their probabilities in the render; empty for an object without parts, whose only part is "".
        weight: 0 where photo and render do not show the same surface.
    """
    names = tuple(parts) or ("",)
    prior = torch.stack(list(parts.values()) or [torch.ones_like(weight)])
    prior = _TRUST * blurred(prior, _BLUR).clamp_min(1e-3).log()
    same = weight > 0
    mixture = _fitted(resized(photo, weight)[:, same], prior[:, same])
    colours = mixture.paint
    groups = mixture.is_paint * torch.eye(len(names))[..., None]
    if "glass" in names:
        groups[0, names.index("glass")] = mixture.vivid_paint[names.index("glass")]
    if set(MATERIALS.values()) <= set(names):
        sure = [names.index(part) for part in MATERIALS.values()]
        groups = torch.cat((groups, mixture.materials(*sure)))
        colours = torch.cat((colours, colours[sure]))
        names += tuple(MATERIALS)
    pixels = zip(photo.flatten(1).split(_BLOCK, 1), enlarged(prior, photo).flatten(1).split(_BLOCK, 1), strict=True)
    shares = [groups.flatten(1) @ mixture.posterior(*block).flatten(1).T for block in pixels]
    return PhotoPaints(names, colours, torch.cat(shares, 1).view(-1, *photo.shape[1:]).half())


@dataclass(frozen=True, eq=False)
class _Mixture:
    """The colours of parts in a photo."""

    moments: Float[Tensor, "parts gaussians 4 4"]  # sums of the products of rows (1, red, green, blue)

    @property
    def weights(self) -> Float[Tensor, "parts gaussians"]:
        """The share of each Gaussian in its part."""
        mass = self.moments[..., 0, 0]
        return mass / mass.sum(1, keepdim=True)

    @property
    def colours(self) -> Float[Tensor, "parts gaussians 3"]:
        """The mean of each Gaussian, sRGB."""
        return self.moments[..., 0, 1:] / self.moments[..., :1, 0]

    def posterior(
        self, photo: Float[Tensor, "3 pixels"], prior: Float[Tensor, "parts pixels"]
    ) -> Float[Tensor, "pixels parts gaussians"]:
        """Return the probabilities of the Gaussians at pixels, given the logarithms of the parts' probabilities."""
        mean = self.colours
        second = self.moments[..., 1:, 1:] / self.moments[..., :1, :1]
        covariance = second - mean[..., None] * mean[..., None, :] + _HUE_NOISE**2 * torch.eye(3) + _LIGHT_NOISE**2
        inverse = torch.linalg.inv(covariance)
        towards = -(inverse @ mean[..., None])
        constant = covariance.logdet()[..., None, None] - mean[..., None, :] @ towards
        form = torch.cat((torch.cat((constant, towards.mT), -1), torch.cat((towards, inverse), -1)), -2)
        distances = torch.einsum("nr,pgr->npg", _products(photo), form.flatten(2))
        logits = self.weights.log() - distances / 2 + prior.T[..., None]
        return logits.flatten(1).softmax(1).view_as(logits)

    @property
    def is_paint(self) -> Float[Tensor, "parts gaussians"]:
        """1 for the largest Gaussian of a part and those of the same paint in another light, 0 for others."""
        main = self.weights.argmax(1)
        largest = self.colours[torch.arange(len(main)), main]
        alike = same_paint(self.colours.movedim(-1, 0), largest.T[..., None])
        return alike.scatter(1, main[:, None], 1.0)

    @property
    def paint(self) -> Float[Tensor, "parts 3"]:
        """The mean colour of each part's paint, sRGB."""
        weight = (self.weights * self.is_paint)[..., None]
        return (weight * self.colours).sum(1) / weight.sum(1)

    @property
    def vivid_paint(self) -> Float[Tensor, "parts gaussians"]:
        """The Gaussians of any part that show the first one's paint, 0..1: pillars and mirrors, but not reflections."""
        colour = self.paint[0]
        alike = same_paint(self.colours.movedim(-1, 0), colour[:, None, None])
        return alike * smooth_step(chroma(colour).norm(), *_VIVID)

    def materials(self, first: int, second: int) -> Float[Tensor, "2 parts gaussians"]:
        """Return the Gaussians of the two materials, 0..1, of which two of the parts are."""
        paints = self.paint[[first, second]]
        if float((paints[0] - paints[1]).norm()) < _ONE_COLOUR:
            is_second = torch.zeros_like(self.weights)
            is_second[second] = 1.0
            return self.is_paint * torch.stack((1 - is_second, is_second))
        colours = self.colours.movedim(-1, 0)
        alike = torch.stack(
            [torch.maximum(self.is_paint, same_paint(colours, paint[:, None, None])) for paint in paints]
        )
        nearest = (self.colours[..., None, :] - paints).norm(dim=-1).argmin(-1)
        return torch.maximum(self.is_paint, alike) * torch.stack((nearest == 0, nearest == 1))


def _fitted(photo: Float[Tensor, "3 pixels"], prior: Float[Tensor, "parts pixels"]) -> _Mixture:
    """Fit a mixture by expectation maximisation, given the logarithms of the parts' probabilities."""
    step = max(1, photo.shape[1] // _SAMPLES)
    photo = photo[:, ::step]
    prior = prior[:, ::step]
    products = _products(photo)
    posterior = _divided(photo, prior.exp())
    for _ in range(_ROUNDS):
        moments = torch.einsum("npg,nr->pgr", posterior, products).unflatten(-1, (4, 4))
        mixture = _Mixture(moments + 1e-6 * torch.eye(4))
        posterior = mixture.posterior(photo, prior)
    return mixture


def _products(photo: Float[Tensor, "3 pixels"]) -> Float[Tensor, "pixels 16"]:
    """Return the products of the entries of the rows (1, red, green, blue)."""
    rows = torch.cat((torch.ones_like(photo[:1]), photo)).T
    return (rows[:, :, None] * rows[:, None]).flatten(1)


def _divided(
    photo: Float[Tensor, "3 pixels"], prior: Float[Tensor, "parts pixels"]
) -> Float[Tensor, "pixels parts gaussians"]:
    """Divide each part's pixels evenly along the axis of its colours' largest variance: a first posterior."""
    posterior = torch.zeros(*prior.T.shape, _GAUSSIANS)
    for part, weight in enumerate(prior / prior.sum(1, keepdim=True).clamp_min(1e-9)):
        offsets = photo.T - photo @ weight
        axis = torch.linalg.eigh((offsets * weight[:, None]).T @ offsets)[1][:, -1]
        order = (offsets @ axis).argsort()
        group = (weight[order].cumsum(0) * _GAUSSIANS).long().clamp_max(_GAUSSIANS - 1)
        posterior[order, part, group] = prior[part, order]
    return posterior
