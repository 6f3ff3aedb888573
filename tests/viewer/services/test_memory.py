"""What was freed goes back to the system."""

import sys
from pathlib import Path

import pytest

from viewer.services.memory import return_free_memory

_BLOCK = 64 * 2**10
"""bytes: small enough that the C library keeps it"""


def resident() -> int:
    """bytes"""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


@pytest.mark.skipif(sys.platform != "linux", reason="others give memory back by themselves")
def test_free_memory_between_kept_blocks_is_returned() -> None:
    blocks = [bytearray(b"\1" * _BLOCK) for _ in range(1000)]
    live_blocks = blocks[::50]
    size = resident()
    del blocks
    return_free_memory()
    assert size - resident() > 0.5 * 1000 * _BLOCK
    assert all(block[-1] == 1 for block in live_blocks)
