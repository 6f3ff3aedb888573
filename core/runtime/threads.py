"""One thread for everything that computes: what the programs of this project start with.

A field's operations are small, and at the end of each all threads wait for the slowest. Where another process takes one
of their cores that is many times slower than one thread, and on idle cores several gain little. Who has more to do
starts more processes.
"""

import os

_SETTINGS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
"""what torch, its matrix library, numpy's and OpenCV read when they are loaded"""


def use_one_thread() -> None:
    """Let libraries that are loaded from now on, and child processes, use one thread: the first line of a program.

    To import :mod:`core` changes nothing: a library leaves threads to its caller.
    """
    os.environ.update(dict.fromkeys(_SETTINGS, "1"))
