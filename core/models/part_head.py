"""Part labels of points: a linear classifier of the features that the density is computed from."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

ABOVE_SEAT = {
    "seat": (-math.inf, 0.05),
    "legs": (-math.inf, 0.03),
    "back": (-0.1, math.inf),
    "arms": (-0.3, math.inf),
}  # scene units above the seat's top, from and to, where a chair's parts may lie


@dataclass(frozen=True, eq=False)
class PartHead:
    """The parts of a category's objects. Raises ``ValueError`` for inconsistent names and weights."""

    names: tuple[str, ...]  # ("body", "wheels", "glass"); the first is everything that is no other part
    weight: Float[Tensor, "parts width"]
    bias: Float[Tensor, "parts"]

    def __post_init__(self) -> None:
        count = len(self.names)
        if count < 2 or len(set(self.names)) < count or not all(self.names):
            raise ValueError(f"a part head needs at least two parts with distinct names, got {self.names}")
        if self.weight.shape[:1] != (count,) or self.bias.shape != (count,):
            raise ValueError(f"{count} parts need as many rows of weights, got {tuple(self.weight.shape)}")
        if not bool(torch.isfinite(self.weight).all() and torch.isfinite(self.bias).all()):
            raise ValueError("the weights of a part head must be finite")

    def __call__(self, features: Float[Tensor, "*points width"]) -> Float[Tensor, "*points parts"]:
        """Return each part's probability from features of :meth:`core.rendering.folded_field.FoldedField.density`."""
        device = features.device
        return functional.linear(features.float(), self.weight.to(device), self.bias.to(device)).softmax(-1)

    def parts(self, features: Float[Tensor, "*points width"]) -> dict[str, Float[Tensor, "*points"]]:
        """Return the probabilities of :meth:`__call__` by the part's name."""
        return dict(zip(self.names, self(features).unbind(-1), strict=True))
