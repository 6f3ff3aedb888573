"""Free memory that glibc would keep, returned to the system. Nothing happens without glibc."""

import ctypes
import sys
from contextlib import suppress

_LARGE = 8 * 2**20  # bytes of a block that is returned at once; with 1 MiB a fit takes a fifth longer
_ARENAS = 2  # glibc's default is eight per core
_M_TRIM_THRESHOLD = -1  # this and the next two: from glibc's malloc.h
_M_MMAP_THRESHOLD = -3
_M_ARENA_MAX = -8


def keep_little_free_memory() -> None:
    """Let glibc keep no large blocks and few arenas. Call before starting threads."""
    for parameter, value in ((_M_TRIM_THRESHOLD, _LARGE), (_M_MMAP_THRESHOLD, _LARGE), (_M_ARENA_MAX, _ARENAS)):
        _glibc("mallopt", parameter, value)


def return_free_memory() -> None:
    """Return free memory now, including that between blocks in use."""
    _glibc("malloc_trim", 0)


def _glibc(function: str, *arguments: int) -> None:
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):  # another C library
            getattr(ctypes.CDLL("libc.so.6"), function)(*arguments)
