"""Linear layers and ReLUs as fast as processors allow: ReLUs as integers, which torch compares and masks several times
faster than bfloat16, and numbers of rows for which oneDNN has a kernel already.
"""

import torch
from jaxtyping import Float, Num
from torch import Tensor
from torch.nn import functional

_ROWS = 512
_INTEGERS = {2: torch.int16, 4: torch.int32, 8: torch.int64}


def linear_relu(
    values: Float[Tensor, "*batch inputs"], weight: Float[Tensor, "outputs inputs"], bias: Float[Tensor, "outputs"]
) -> Float[Tensor, "*batch outputs"]:
    """``relu(values @ weight.T + bias)``, not differentiable."""
    return relu_(functional.linear(values, weight, bias))


def relu_(values: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """``values.relu_()``, unseen by autograd: what is negative is so as an integer too.

    A NaN may become 0: what is not finite is noticed before the field is evaluated.
    """
    _as_integers(values).clamp_min_(0)
    return values


def relu_backward_(
    gradient: Float[Tensor, "*batch width"], activations: Float[Tensor, "*#batch width"]
) -> Float[Tensor, "*batch width"]:
    """The gradient taken back through a ReLU, in place: 0 where its output, which is never negative, is 0."""
    _as_integers(gradient).bitwise_and_(_as_integers(activations).clamp_max(1).neg_())  # -1 has all bits, 0 none
    return gradient


def _as_integers(values: Tensor) -> Tensor:
    return values.view(_INTEGERS[values.element_size()])


def pad_rows(rows: Num[Tensor, "some *width"]) -> Num[Tensor, "more *width"]:
    """The rows, followed by as many of zeros as make a multiple of 512.

    oneDNN compiles a kernel for every count of rows that it has not met, which takes longer than to run it.
    """
    return functional.pad(rows, (*(0, 0) * (rows.ndim - 1), 0, -len(rows) % _ROWS)) if len(rows) % _ROWS else rows
