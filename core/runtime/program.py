"""The command that started this process, for its messages."""

import sys
from pathlib import Path


def program_name(package: str, script: str) -> str:
    """Return the console script ``script`` if that was started, else ``python -m package``."""
    return script if Path(sys.argv[0]).stem == script else f"python -m {package}"
