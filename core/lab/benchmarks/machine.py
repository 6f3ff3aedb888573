"""The code and the machine that measure, in a few words."""

import platform
import subprocess
from datetime import date
from pathlib import Path

import torch

from core.runtime.precision import matmul_dtype

_ROOT = Path(__file__).resolve().parents[3]
_MEASURED = ("core", "assets/models", "assets/networks", "assets/benchmark")  # files that decide the results


def describe_processor() -> str:
    """Return the kind of processor, the number format of its multiplications and torch's version."""
    dtype = str(matmul_dtype("cpu")).removeprefix("torch.")
    return f"{platform.machine()} {torch.backends.cpu.get_cpu_capability()}, {dtype}, torch {torch.__version__}"


def describe_code(root: Path = _ROOT) -> str:
    """Return the last commit of the files that decide the results, with + for changes since; "unknown" without git.

    Commits of documents leave it as it is, so measurements can be resumed after them.
    """
    try:
        commit = _git(root, "log", "-1", "--format=%h", "--", *_MEASURED)
        changed = _git(root, "status", "--porcelain", "--untracked-files=no", "--", *_MEASURED)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return f"{commit}{'+' if changed else ''}"


def conditions() -> dict[str, str]:
    """Return the columns of each measurement's origin."""
    return {"commit": describe_code(), "processor": describe_processor(), "date": date.today().isoformat()}


def _git(root: Path, *words: str) -> str:
    return subprocess.run(("git", *words), cwd=root, capture_output=True, text=True, check=True).stdout.strip()
