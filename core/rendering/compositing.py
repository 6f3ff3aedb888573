"""Volume rendering (Eq. 3): densities between edges become weights; the light left over belongs to the ground."""

import torch
from jaxtyping import Float
from torch import Tensor


def weights(
    density: Float[Tensor, "*batch samples"], edges: Float[Tensor, "*batch samples_and_one"]
) -> tuple[Float[Tensor, "*batch samples"], Float[Tensor, "*batch"]]:
    """The share of a ray's light that each interval gives, and the share that is left over.

    Eq. 3 with :math:`\\delta_i = t_{i+1} - t_i`: interval i weighs
    :math:`T_i (1 - e^{-\\sigma_i \\delta_i}) = T_i - T_{i+1}` with :math:`T_i = e^{-\\sum_{j<i} \\sigma_j \\delta_j}`,
    in float32 right to 1e-7. There are as many intervals as densities and one edge more, so no last interval is
    invented. Weights and left-over light sum to one.

    Args:
        density: per scene unit, not negative.
        edges: scene units along the ray, non-decreasing.

    Example:
        >>> shares, left = weights(torch.tensor([1e9]), torch.tensor([0.0, 1.0]))
        >>> float(shares), float(left)
        (1.0, 0.0)
    """
    depth = density * edges.diff(dim=-1)
    # Padded before the sum: cumsum(x) - x would be inf - inf for an opaque interval.
    passed = torch.nn.functional.pad(depth.cumsum(-1), (1, 0))
    light = torch.exp(-passed)
    return light[..., :-1] - light[..., 1:], light[..., -1]


def over_white(
    shares: Float[Tensor, "*batch samples"],
    left: Float[Tensor, "*batch"],
    colours: Float[Tensor, "*batch samples 3"],
) -> Float[Tensor, "*batch 3"]:
    """Eq. 3's colour, with the left-over light falling on a white ground."""
    return (shares[..., None] * colours).sum(-2) + left[..., None]
