"""Thread counts: torch's own and the pool's (:mod:`core.runtime.pool`). Imports no torch."""

import os
from contextlib import suppress
from functools import cache
from itertools import product
from pathlib import Path, PurePosixPath

VARIABLE = "CODENERF_THREADS"  # environment: threads of the pool, instead of one per core
_LIBRARIES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
"""Read by OpenMP, MKL, OpenBLAS and OpenCV when they are loaded."""
_LIMITS = ("", ("cpu.max",)), ("cpu", ("cpu.cfs_quota_us", "cpu.cfs_period_us"))
"""Folder of control groups of version 2 and 1, and files: microseconds of processor time per period, the period."""


def use_one_torch_thread() -> None:
    """Limit libraries that are loaded from now on, and child processes, to one thread.

    Call first in a program. Importing :mod:`core` does not do so: a library leaves torch's threads to its caller.
    """
    os.environ.update(dict.fromkeys(_LIBRARIES, "1"))


def use_threads(count: int | None) -> None:
    """Set the number of pool threads of this process and its children; None keeps the environment's."""
    if count is not None:
        os.environ[VARIABLE] = str(count)


def thread_count() -> int:
    """Return the number of pool threads: ``CODENERF_THREADS``, else one per core of this process.

    Raises ``ValueError`` unless the variable is a positive whole number.
    """
    setting = os.environ.get(VARIABLE)
    if setting is None:
        return available_cores()
    if not (setting.isdecimal() and int(setting)):
        raise ValueError(f"{VARIABLE} is a number of threads, got {setting!r}")
    return int(setting)


@cache
def available_cores(cgroups: Path = Path("/sys/fs/cgroup"), groups: Path = Path("/proc/self/cgroup")) -> int:
    """Return the number of cores that affinity, and the limits of all control groups around this process, grant it.

    Args:
        groups: lists the process's groups.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    for (folder, names), group in product(_LIMITS, _enclosing(groups)):
        with suppress(OSError, ValueError):  # no such file, or no limit ("max")
            texts = [(cgroups / folder / group / name).read_text() for name in names]
            quota, period = map(int, " ".join(texts).split())
            cores = min(cores, -(-quota // period)) if quota > 0 else cores
    return max(1, cores)


def _enclosing(groups: Path) -> set[PurePosixPath]:
    """Return the control groups that a process belongs to, and those around them; the outermost is ``.``."""
    paths = {PurePosixPath()}
    with suppress(OSError, ValueError):  # ValueError: not UTF-8
        for line in groups.read_text().splitlines():
            group = PurePosixPath(line.split(":", 2)[2].lstrip("/"))
            paths |= {group, *group.parents}
    return paths
