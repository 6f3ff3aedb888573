"""The user's folder for configuration; a temporary folder for users without a home."""

import os
import tempfile
from pathlib import Path

from platformdirs import user_config_path

_NAME = "codenerf-viewer"


def config_folder() -> Path:
    """Return the folder of preferences, window layout and sessions.

    It is a temporary one for a user without a (writable) home.
    """
    try:
        folder = user_config_path(_NAME, appauthor=False, roaming=True)
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except (OSError, RuntimeError):  # a missing home is a RuntimeError
        pass
    user = getattr(os, "getuid", int)()
    folder = Path(tempfile.gettempdir()) / f"{_NAME}-{user}"
    folder.mkdir(mode=0o700, exist_ok=True)
    if getattr(folder.stat(), "st_uid", user) != user:  # created by somebody else
        return Path(tempfile.mkdtemp(prefix=f"{_NAME}-"))
    return folder


def is_temporary(folder: Path) -> bool:
    """True if a folder lies in the system's temporary folder, which is emptied at times."""
    return folder.parent == Path(tempfile.gettempdir())
