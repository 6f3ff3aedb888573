"""The modes of torch, which belong to a thread."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import torch


class TorchModes(NamedTuple):
    """Gradient, inference and autocast modes of a thread."""

    inference: bool
    grad: bool
    autocast: bool
    dtype: torch.dtype  # of autocast

    @classmethod
    def current(cls) -> "TorchModes":
        """Return the modes of this thread."""
        autocast = torch.is_autocast_enabled("cpu")
        dtype = torch.get_autocast_dtype("cpu")
        return cls(torch.is_inference_mode_enabled(), torch.is_grad_enabled(), autocast, dtype)

    @contextmanager
    def applied(self) -> Iterator[None]:
        """Apply the modes inside a ``with``; the former ones return at its end in any case."""
        with (
            torch.inference_mode(self.inference),
            torch.set_grad_enabled(self.grad),
            torch.autocast("cpu", enabled=self.autocast, dtype=self.dtype),
        ):
            yield
