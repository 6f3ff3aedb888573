"""Memory that is free, back to the system."""

import ctypes
import sys
from contextlib import suppress


def return_free_memory() -> None:
    """Give back what was freed between values that are still there; glibc keeps it otherwise. Elsewhere nothing."""
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):  # another C library
            ctypes.CDLL("libc.so.6").malloc_trim(0)
