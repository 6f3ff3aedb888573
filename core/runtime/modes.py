"""The modes of torch, which belong to a thread, and torch's usual settings during calls of this library."""

from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager
from functools import wraps
from inspect import isgeneratorfunction, unwrap
from typing import Any, NamedTuple, ParamSpec, TypeVar

import torch
from torch.backends import mkldnn

from core.runtime.process import SharedContext

_MKLDNN: Any = mkldnn  # its settings are attributes made at run time
_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


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


def isolated(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Decorate a function, or a generator function, to run in :func:`usual_settings`; for entry points.

    Between the steps of a generator the caller's settings hold.

    Example:
        >>> @isolated
        ... def zeros():
        ...     return torch.zeros(3, device="cpu").dtype
        >>> torch.set_default_dtype(torch.float64)
        >>> zeros(), torch.get_default_dtype()
        (torch.float32, torch.float64)
        >>> torch.set_default_dtype(torch.float32)
    """

    @wraps(function)
    def stream(*arguments: _Arguments.args, **options: _Arguments.kwargs) -> Generator[Any, None, Any]:
        steps: Any = function(*arguments, **options)
        try:
            while True:
                with usual_settings():
                    try:
                        value = next(steps)
                    except StopIteration as done:
                        return done.value
                yield value
        finally:
            with usual_settings():
                steps.close()

    return stream if isgeneratorfunction(unwrap(function)) else usual_settings()(function)  # type: ignore[return-value]


@contextmanager
def usual_settings() -> Iterator[None]:
    """Apply torch's usual settings inside a ``with``: float32 on the processor, no modes, one thread.

    The caller's settings return at its end. Values for caches are computed in it. Gradients stay as the caller has
    them, unless inference mode disables them.
    """
    with ExitStack() as stack:
        stack.enter_context(_USUAL_FORMATS)
        if torch.is_inference_mode_enabled():
            stack.enter_context(torch.inference_mode(False))
        for device in ("cpu", "cuda"):
            if torch.is_autocast_enabled(device):
                stack.enter_context(torch.autocast(device, enabled=False))
        if torch.get_default_device().type != "cpu":
            stack.enter_context(torch.device("cpu"))
        threads = torch.get_num_threads()
        if threads != 1:  # sums depend on it; the pool has the other cores
            stack.callback(torch.set_num_threads, threads)
            torch.set_num_threads(1)
        yield


@contextmanager
def _usual_formats() -> Iterator[None]:
    of_caller = torch.get_default_dtype(), _MKLDNN.matmul.fp32_precision, _MKLDNN.conv.fp32_precision
    _set_formats(torch.float32, "ieee", "ieee")
    yield
    _set_formats(*of_caller)


def _set_formats(dtype: torch.dtype, products: str, convolutions: str) -> None:
    torch.set_default_dtype(dtype)
    _MKLDNN.matmul.fp32_precision = products
    _MKLDNN.conv.fp32_precision = convolutions


_USUAL_FORMATS = SharedContext(_usual_formats)
