"""The machine that runs a benchmark."""

import platform

import torch

from core.runtime.precision import matmul_dtype
from core.runtime.threads import thread_count


def describe_machine(device: torch.device) -> str:
    """Return processor, threads, precision and torch version in one line."""
    dtype = str(matmul_dtype(device.type)).removeprefix("torch.")
    card = f"{torch.cuda.get_device_name(device)}, " if device.type == "cuda" else ""
    return f"{card}{platform.machine()}, {thread_count()} threads, {dtype}, torch {torch.__version__}"
