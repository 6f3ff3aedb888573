"""The processes of one training run, started by ``torchrun``, on one machine or several.

Each process has the rays of its own objects and all of the weights. All draw the same random numbers, and the sums of
their gradients are those of a run of one process, up to rounding.
"""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor, distributed

_LOST = "another process of this training has ended: start all again, with --resume once there is a state file"


@dataclass(frozen=True)
class Processes:
    """This process and the number of processes that train together; by default this one alone."""

    rank: int = 0  # the first writes and prints
    count: int = 1

    @property
    def own(self) -> slice:
        """Slice of this process's objects in a sequence of all."""
        return slice(self.rank, None, self.count)

    def add(self, *values: Tensor) -> None:
        """Replace tensors, in place, by their sums over the processes. Raises ``ValueError`` if a process ended."""
        if self.count > 1:
            sums = torch.cat([value.flatten() for value in values])  # one message
            _reduce(sums, distributed.ReduceOp.SUM)
            for value, total in zip(values, sums.split([value.numel() for value in values]), strict=True):
                value.copy_(total.view_as(value))

    def intersect(self, masks: Tensor) -> None:
        """Replace a boolean tensor, in place, by what all processes have as True."""
        if self.count > 1:
            _reduce(masks.view(torch.uint8), distributed.ReduceOp.MIN)


ALONE = Processes()


@contextmanager
def training_processes(device: str) -> Iterator[Processes]:
    """Connect the processes that ``torchrun`` started; without it, this one is alone.

    Of an error that stops several processes, only the first to report it raises; the others exit with status 2.
    Raises ``ValueError`` if there are more processes than graphics cards.
    """
    if not distributed.is_torchelastic_launched():
        yield ALONE
        return
    store, rank, count = next(distributed.rendezvous("env://"))
    if rank > 0:  # only the first process has files to tidy, and messages wait in C++
        for kind in (signal.SIGINT, signal.SIGTERM):
            signal.signal(kind, signal.SIG_DFL)
    try:
        if device == "cuda":
            number = int(os.environ["LOCAL_RANK"])
            cards = torch.cuda.device_count()
            if number >= cards:
                needed = f"process {number + 1} of this machine needs a graphics card of its own"
                raise ValueError(f"{needed}, torch finds {cards}")
            torch.cuda.set_device(number)
        distributed.init_process_group("nccl" if device == "cuda" else "gloo", store=store, rank=rank, world_size=count)
        yield Processes(rank, count)
        distributed.destroy_process_group()
    except (ValueError, OSError):
        if store.add("failures", 1) > 1:
            sys.exit(2)
        raise


def _reduce(values: Tensor, operation: distributed.ReduceOp.RedOpType) -> None:
    try:
        distributed.all_reduce(values, operation)
    except RuntimeError as error:  # of gloo and nccl, for lost connections
        raise ValueError(_LOST) from error
