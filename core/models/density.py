"""Density from the network's logit: a scaled softplus, then contrast.

Contrast makes surfaces crisp. Training images show an edge as a mean over pixels, so a softplus there is neither empty
nor opaque. :math:`\\sigma' = \\sigma \\min(\\sigma / \\sigma_0, g)` thins densities below :math:`\\sigma_0` and
multiplies the rest by up to g.
"""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from core.models.field_config import FieldConfig


def logits_to_density(logits: Float[Tensor, "*batch"], config: FieldConfig) -> Float[Tensor, "*batch"]:
    """Return the density (per scene unit) of the network's logits."""
    density = config.density_scale * functional.softplus(logits)
    if not config.contrast:
        return density
    return density * (density / config.contrast).clamp_max(config.contrast_gain)


def density_derivative(density: Float[Tensor, "*batch"], config: FieldConfig) -> Float[Tensor, "*batch"]:
    """Return the derivative of :func:`logits_to_density` with respect to the logit, from the density itself."""
    soft, slope = density, torch.ones_like(density)
    if config.contrast:
        soft = without_contrast(density, config)
        below = soft < config.contrast * config.contrast_gain
        slope = torch.where(below, 2 * soft / config.contrast, config.contrast_gain)
    return slope * config.density_scale * -torch.expm1(-soft / config.density_scale)


def without_contrast(density: Float[Tensor, "*batch"], config: FieldConfig) -> Float[Tensor, "*batch"]:
    """Return the density before contrast was applied."""
    if not config.contrast:
        return density
    return torch.maximum(
        density / config.contrast_gain,
        (density * config.contrast).sqrt().clamp_max(config.contrast * config.contrast_gain),
    )


def density_to_logits(density: Float[Tensor, "*batch"], config: FieldConfig) -> Float[Tensor, "*batch"]:
    """Return the logits of densities; infinite for densities too large for float32."""
    share = (without_contrast(density, config) / config.density_scale).clamp_min(1e-6)
    return share + torch.log(-torch.expm1(-share))
