"""Number format of linear layers, chosen by measurement on this machine."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import torch

_FIRST, _EMULATED = 4, 3.0  # first rounds, and the ratio of times: if bfloat16 is slower in each, measuring ends
_ROUNDS = 20  # further rounds otherwise
_forced: torch.dtype | None = None  # by use_dtype


def require_device(name: str) -> torch.device:
    """Return the device "cpu" or "cuda". Raises ``ValueError`` if this machine lacks it."""
    if name == "cuda" and not torch.cuda.is_available():
        raise ValueError("torch finds no CUDA device on this machine")
    return torch.device(name)


def matmul_dtype(device_type: str) -> torch.dtype:
    """Return bfloat16 if this machine multiplies it at least 1.2 times faster than float32, else float32.

    Processors with bfloat16 units run a field's layers 2 to 5 times faster; others emulate it slowly. Encoding,
    compositing, and the state of fits and training stay in float32.
    """
    return _forced or _fastest_dtype(device_type)


@contextmanager
def use_dtype(dtype: torch.dtype) -> Iterator[None]:
    """Force the number format of linear layers inside a ``with``, for ablations and tests."""
    global _forced
    previous = _forced
    _forced = dtype
    try:
        yield
    finally:
        _forced = previous


@cache
def _fastest_dtype(device_type: str) -> torch.dtype:
    if device_type == "cuda":
        return torch.bfloat16 if torch.cuda.is_bf16_supported() else torch.float32
    # Formats alternate, so that other load affects both. The lower quartiles are compared, as a minimum may be a lucky
    # outlier. One thread measures: beside a busy process, several threads wait for each other, equally long in both
    # formats.
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        rounds = [(_layer_seconds(torch.float32), _layer_seconds(torch.bfloat16)) for _ in range(_FIRST)]
        if all(half > _EMULATED * single for single, half in rounds):
            return torch.float32
        rounds += [(_layer_seconds(torch.float32), _layer_seconds(torch.bfloat16)) for _ in range(_ROUNDS)]
    finally:
        torch.set_num_threads(threads)
    single, half = (sorted(column)[_ROUNDS // 4] for column in zip(*rounds, strict=True))
    return torch.bfloat16 if 1.2 * half < single else torch.float32


def autocast(device: torch.device) -> torch.autocast:
    """Return a context in which linear layers run in :func:`matmul_dtype`."""
    dtype = matmul_dtype(device.type)
    return torch.autocast(device.type, dtype=torch.bfloat16, enabled=dtype == torch.bfloat16)


def _layer_seconds(dtype: torch.dtype) -> float:
    layer = torch.nn.Linear(128, 128).to(dtype)
    values = torch.ones(1024, 128, dtype=dtype)
    with torch.no_grad():
        layer(values)
        began = time.perf_counter()
        layer(values).relu()
    return time.perf_counter() - began
