"""Fast linear layers and ReLUs on processors.

ReLUs work on integers, which torch compares and masks several times faster than bfloat16. Row counts are padded so that
oneDNN has a compiled kernel.
"""

import torch
from jaxtyping import Float, Num
from torch import Tensor
from torch.nn import functional

_ROWS = 512  # row counts are padded to a multiple
_INTEGERS = {2: torch.int16, 4: torch.int32, 8: torch.int64}
_CHUNK_POINTS = {torch.bfloat16: 8192, torch.float32: 4096}


def chunk_points(dtype: torch.dtype) -> int:
    """Return the number of points to evaluate at a time in a number format.

    Fewer cost more in calls, more leave the cache. Units for bfloat16 multiply so fast that calls cost most.
    """
    return _CHUNK_POINTS[dtype]


def linear_relu(
    values: Float[Tensor, "*batch inputs"], weight: Float[Tensor, "outputs inputs"], bias: Float[Tensor, "outputs"]
) -> Float[Tensor, "*batch outputs"]:
    """Compute ``relu(values @ weight.T + bias)`` without autograd."""
    return relu_(functional.linear(values, weight, bias))


def relu_(values: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """Apply ``values.relu_()`` without autograd, on integers: negative floats are negative integers.

    A NaN may become 0: callers check for finite values before evaluating the field.
    """
    _as_integers(values).clamp_min_(0)
    return values


def relu_backward_(
    gradient: Float[Tensor, "*batch width"], activations: Float[Tensor, "*#batch width"]
) -> Float[Tensor, "*batch width"]:
    """Set a gradient to 0, in place, where the ReLU's output ``activations`` is 0."""
    _as_integers(gradient).bitwise_and_(_as_integers(activations).clamp_max(1).neg_())  # -1 has all bits set
    return gradient


def _as_integers(values: Tensor) -> Tensor:
    return values.view(_INTEGERS[values.element_size()])


def pad_rows(rows: Num[Tensor, "rows *width"]) -> Num[Tensor, "padded *width"]:
    """Append zero rows up to a multiple of 512.

    oneDNN compiles a kernel for every new number of rows, which takes longer than running it.
    """
    return functional.pad(rows, (*(0, 0) * (rows.ndim - 1), 0, -len(rows) % _ROWS)) if len(rows) % _ROWS else rows
