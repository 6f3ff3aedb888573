"""Density from the network's logit: a scaled softplus, then contrast.

Contrast makes surfaces crisp. Pixels of training images average over edges, so the softplus learns a half-transparent
layer there. Contrast replaces a density :math:`\\sigma` by :math:`\\sigma \\min(\\sigma / \\sigma_0, g)`: densities
below :math:`\\sigma_0` become thinner, and the others up to g times denser.
"""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from core.models.field_config import FieldConfig


def logits_to_density(logits: Float[Tensor, "*batch"], config: FieldConfig) -> Float[Tensor, "*batch"]:
    """Convert the network's logits to densities per scene unit."""
    density = config.density_scale * functional.softplus(logits)
    if not config.contrast:
        return density
    return density * (density / config.contrast).clamp_max(config.contrast_gain)


def density_derivative(density: Float[Tensor, "*batch"], config: FieldConfig) -> Float[Tensor, "*batch"]:
    """Return the derivative of :func:`logits_to_density` at the logits that give these densities."""
    soft = density
    slope = torch.ones_like(density)
    if config.contrast:
        soft = without_contrast(density, config)
        below = soft < config.contrast * config.contrast_gain
        slope = torch.where(below, 2 * soft / config.contrast, config.contrast_gain)
    return slope * config.density_scale * -torch.expm1(-soft / config.density_scale)


def without_contrast(density: Float[Tensor, "*batch"], config: FieldConfig) -> Float[Tensor, "*batch"]:
    """Invert contrast: return the scaled softplus that gave these densities."""
    if not config.contrast:
        return density
    return torch.maximum(
        density / config.contrast_gain,
        (density * config.contrast).sqrt().clamp_max(config.contrast * config.contrast_gain),
    )


def density_to_logits(density: Float[Tensor, "*batch"], config: FieldConfig) -> Float[Tensor, "*batch"]:
    """Invert :func:`logits_to_density`; infinite for infinite densities, about -13.8 for zero."""
    softplus = (without_contrast(density, config) / config.density_scale).clamp_min(1e-6)
    return softplus + torch.log(-torch.expm1(-softplus))
