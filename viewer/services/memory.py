"""Memory that is free, back to the system: glibc keeps it otherwise. Elsewhere nothing is done."""

import ctypes
import sys
from contextlib import suppress

_LARGE = 8 * 2**20  # bytes: larger blocks go back at once; with 1 MiB a fit takes a fifth longer
_ARENAS = 2
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8  # as malloc.h of glibc has them


def keep_little_free_memory() -> None:
    """Keep no large blocks, and few pools of small ones. To be called before there are other threads."""
    for parameter, value in ((_M_TRIM_THRESHOLD, _LARGE), (_M_MMAP_THRESHOLD, _LARGE), (_M_ARENA_MAX, _ARENAS)):
        _glibc("mallopt", parameter, value)


def return_free_memory() -> None:
    """Give back what was freed between values that are still there."""
    _glibc("malloc_trim", 0)


def _glibc(function: str, *arguments: int) -> None:
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):  # another C library
            getattr(ctypes.CDLL("libc.so.6"), function)(*arguments)
