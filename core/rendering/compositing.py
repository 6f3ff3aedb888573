"""Volume rendering (Eq. 3): the weights of intervals, and the transmittance, which is the background's weight."""

import torch
from jaxtyping import Float
from torch import Tensor


def compositing_weights(
    density: Float[Tensor, "*batch samples"], edges: Float[Tensor, "*batch samples_and_one"]
) -> tuple[Float[Tensor, "*batch samples"], Float[Tensor, "*batch"]]:
    """Return the weight of each interval in its ray's colour, and the ray's transmittance.

    Eq. 3 with :math:`\\delta_i = t_{i+1} - t_i`: interval i weighs :math:`T_i (1 - e^{-\\sigma_i \\delta_i}) = T_i -
    T_{i+1}` with :math:`T_i = e^{-\\sum_{j<i} \\sigma_j \\delta_j}`, accurate to 1e-7 in float32. With one edge more
    than densities, the last interval has a length too. Weights and transmittance sum to one.

    Args:
        density: per scene unit, not negative.
        edges: scene units along the ray, non-decreasing.

    Example:
        >>> weights, transmittance = compositing_weights(torch.tensor([1e9]), torch.tensor([0.0, 1.0]))
        >>> float(weights), float(transmittance)
        (1.0, 0.0)
    """
    thickness = density * edges.diff(dim=-1)
    # Padded before the sum: cumsum(x) - x would be inf - inf for an opaque interval.
    depths = torch.nn.functional.pad(thickness.cumsum(-1), (1, 0))
    transmittance = torch.exp(-depths)
    return transmittance[..., :-1] - transmittance[..., 1:], transmittance[..., -1]


def composite_on_white(
    weights: Float[Tensor, "*batch samples"],
    transmittance: Float[Tensor, "*batch"],
    colours: Float[Tensor, "*batch samples 3"],
) -> Float[Tensor, "*batch 3"]:
    """Composite Eq. 3's colour over a white background."""
    return (weights[..., None] * colours).sum(-2) + transmittance[..., None]
