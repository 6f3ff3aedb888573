"""The latent numbers of an object: a shape code and a texture code, and offsets of the biases that they become.

Codes reach the network as biases (:class:`core.models.field.Field`). What codes can say is a thin surface in the space
of those biases; offsets lead off it, to objects unlike the training objects (:mod:`core.fitting.free`).
"""

import base64
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Float16
from torch import Tensor

CodeKind = Literal["shape", "texture"]
CODE_KINDS: tuple[CodeKind, CodeKind] = ("shape", "texture")


@dataclass(frozen=True, eq=False)
class Latents:
    """A shape code and a texture code with offsets, or a batch of such pairs; compared by value.

    Raises ``ValueError`` for numbers that are not finite.
    """

    shape: Float[Tensor, "*batch shape_latent"]
    texture: Float[Tensor, "*batch texture_latent"]
    shape_offsets: Float16[Tensor, "blocks width"] | None = None
    """of the shape blocks' biases, in standard deviations (:attr:`core.models.model.Model.bias_std`); None: zeros"""
    texture_offsets: Float16[Tensor, "more_blocks width"] | None = None  # of the texture blocks' biases

    def __post_init__(self) -> None:
        numbers = (self.shape, self.texture, self.shape_offsets, self.texture_offsets)
        if not all(bool(torch.isfinite(tensor).all()) for tensor in numbers if tensor is not None):
            raise ValueError("codes must be finite")

    @property
    def shape_key(self) -> tuple[Hashable, ...]:
        """All numbers of the shape, as a comparable key."""
        return _key(self.shape, self.shape_offsets)

    @property
    def texture_key(self) -> tuple[Hashable, ...]:
        """All numbers of the texture, as a comparable key."""
        return _key(self.texture, self.texture_offsets)

    def __eq__(self, value: object) -> bool:
        if not isinstance(value, Latents):
            return NotImplemented
        return self.shape_key == value.shape_key and self.texture_key == value.texture_key

    def __hash__(self) -> int:
        return hash((self.shape_key, self.texture_key))

    def __getstate__(self) -> dict[str, object]:
        """Return the fields to pickle; a row of a code book without the book."""
        return {
            name: value.detach().clone() if isinstance(value, Tensor) else value for name, value in vars(self).items()
        }

    def detached(self) -> "Latents":
        """Return a copy on the processor, without gradients."""

        def copy(tensor: Tensor) -> Tensor:
            return tensor.detach().cpu().clone()

        offsets = (tensor if tensor is None else copy(tensor) for tensor in (self.shape_offsets, self.texture_offsets))
        return Latents(copy(self.shape), copy(self.texture), *offsets)

    def offsets_json(self) -> dict[str, list[str]]:
        """Return the offsets as JSON-compatible texts, one for each block; :func:`read_offsets` reads them back."""
        named = {"shape_offsets": self.shape_offsets, "texture_offsets": self.texture_offsets}
        return {name: _to_texts(offsets) for name, offsets in named.items() if offsets is not None}


def read_offsets(texts: tuple[str, ...] | None) -> Float16[Tensor, "blocks width"] | None:
    """Decode the offsets of blocks; None stays None. Raises ``ValueError`` for other texts."""
    if texts is None:
        return None
    blocks = [np.frombuffer(base64.b64decode(text, validate=True), np.float16) for text in texts]
    if len({len(block) for block in blocks}) != 1:
        raise ValueError("offsets need blocks of one width")
    return torch.from_numpy(np.stack(blocks))


def _to_texts(offsets: Float16[Tensor, "blocks width"]) -> list[str]:
    return [base64.b64encode(block.tobytes()).decode() for block in offsets.cpu().numpy()]


def _key(code: Tensor, offsets: Tensor | None) -> tuple[float, ...]:
    return tuple(code.flatten().tolist()) + (() if offsets is None else tuple(offsets.flatten().tolist()))


def mixed_offsets(
    first: Float16[Tensor, "blocks width"] | None, second: Float16[Tensor, "blocks width"] | None, amount: float
) -> Float16[Tensor, "blocks width"] | None:
    """Interpolate linearly from the first offsets (amount 0) to the second (1); None stands for zeros."""
    if first is None and second is None:
        return None
    first = torch.zeros_like(second) if first is None else first  # type: ignore[arg-type]
    second = torch.zeros_like(first) if second is None else second
    return torch.lerp(first.float(), second.float(), amount).half()
