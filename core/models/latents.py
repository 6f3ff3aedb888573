"""The latent numbers of an object: a shape code and a texture code, and offsets of the network from the category's.

Codes reach the network as biases (:class:`core.models.field.Field`). What codes can say is a thin surface in the space
of those biases; offsets lead off it, to objects unlike the training objects (:mod:`core.fitting.free`). An object of
photos from several sides has offsets of weights, too, and so a network of its own (:mod:`core.models.network`).
"""

import base64
from collections.abc import Hashable
from dataclasses import dataclass, fields
from functools import cached_property
from hashlib import sha256
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Float16
from torch import Tensor
from torch.nn.functional import pad

CodeKind = Literal["shape", "texture"]
CODE_KINDS: tuple[CodeKind, CodeKind] = ("shape", "texture")


@dataclass(frozen=True, eq=False)
class Latents:
    """A shape code and a texture code with offsets, or a batch of such pairs; compared by value.

    Raises ``ValueError`` for numbers that are not finite.
    """

    shape: Float[Tensor, "*batch shape_latent"]
    texture: Float[Tensor, "*batch texture_latent"]
    shape_offsets: Float16[Tensor, "rows width"] | None = None
    """Offsets of the shape blocks' biases, in standard deviations (:attr:`core.models.model.Model.bias_std`); then, if
    the object has its own network, of :attr:`core.models.field.Field.shape_weights`. None: zeros."""
    texture_offsets: Float16[Tensor, "more_rows width"] | None = None  # the same of the texture part

    def __post_init__(self) -> None:
        numbers = (self.shape, self.texture, self.shape_offsets, self.texture_offsets)
        if not all(bool(torch.isfinite(tensor).all()) for tensor in numbers if tensor is not None):
            raise ValueError("codes must be finite")

    @property
    def shape_key(self) -> tuple[Hashable, ...]:
        """All numbers of the shape, as a comparable key."""
        return self._keys[0]

    @property
    def texture_key(self) -> tuple[Hashable, ...]:
        """All numbers of the texture, as a comparable key."""
        return self._keys[1]

    @cached_property
    def _keys(self) -> tuple[tuple[Hashable, ...], tuple[Hashable, ...]]:
        return _key(self.shape, self.shape_offsets), _key(self.texture, self.texture_offsets)

    def __eq__(self, value: object) -> bool:
        if not isinstance(value, Latents):
            return NotImplemented
        return self.shape_key == value.shape_key and self.texture_key == value.texture_key

    def __hash__(self) -> int:
        return hash((self.shape_key, self.texture_key))

    def __getstate__(self) -> dict[str, object]:
        """Return the fields to pickle; a row of a code book without the book."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return {name: value.detach().clone() if isinstance(value, Tensor) else value for name, value in values.items()}

    @property
    def untextured(self) -> "Latents":
        """The shape alone, as a key of caches."""
        return Latents(self.shape, torch.zeros_like(self.texture), self.shape_offsets)

    def detached(self) -> "Latents":
        """Return a copy on the processor, without gradients."""

        def copy(tensor: Tensor) -> Tensor:
            return tensor.detach().cpu().clone()

        offsets = (tensor if tensor is None else copy(tensor) for tensor in (self.shape_offsets, self.texture_offsets))
        return Latents(copy(self.shape), copy(self.texture), *offsets)

    def offsets_json(self) -> dict[str, list[str]]:
        """Return the offsets as JSON-compatible texts, one for each row; :func:`read_offsets` reads them back."""
        named = {"shape_offsets": self.shape_offsets, "texture_offsets": self.texture_offsets}
        return {name: _to_texts(offsets) for name, offsets in named.items() if offsets is not None}


def read_offsets(texts: tuple[str, ...]) -> Float16[Tensor, "rows width"]:
    """Decode the rows of offsets. Raises ``ValueError`` for other texts."""
    rows = [np.frombuffer(base64.b64decode(text, validate=True), np.float16) for text in texts]
    if len({len(row) for row in rows}) != 1:
        raise ValueError("offsets need rows of one width")
    return torch.from_numpy(np.stack(rows))


def _to_texts(offsets: Float16[Tensor, "rows width"]) -> list[str]:
    return [base64.b64encode(row.tobytes()).decode() for row in offsets.cpu().numpy()]


def _key(code: Tensor, offsets: Tensor | None) -> tuple[Hashable, ...]:
    # A hash, as caches keep keys and a network has 100,000 numbers. Adding zero turns -0.0 into 0.0, which is equal.
    digests = () if offsets is None else (sha256((offsets + 0.0).cpu().numpy().tobytes()).digest(),)
    return *code.flatten().tolist(), *digests


def mixed_offsets(
    first: Float16[Tensor, "rows width"] | None, second: Float16[Tensor, "more_rows width"] | None, amount: float
) -> Float16[Tensor, "most_rows width"] | None:
    """Interpolate linearly from the first offsets (amount 0) to the second (1); missing ones are zeros."""
    if first is None or second is None:
        offsets = second if first is None else first
        scale = amount if first is None else 1 - amount
        return None if offsets is None else (scale * offsets.float()).half()
    rows = max(len(first), len(second))
    first, second = (pad(offsets.float(), (0, 0, 0, rows - len(offsets))) for offsets in (first, second))
    return torch.lerp(first, second, amount).half()
