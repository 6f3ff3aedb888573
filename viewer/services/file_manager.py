"""The system's file manager."""

import subprocess
import sys
from pathlib import Path


def folder_command(path: Path, platform: str = sys.platform) -> list[str]:
    """Return the command that shows a file in its folder; on Linux, where file managers differ, the folder alone.

    Example:
        >>> folder_command(Path("/home/me/chair.glb"), "darwin")
        ['open', '-R', '/home/me/chair.glb']
    """
    commands = {"darwin": ["open", "-R", str(path)], "win32": ["explorer", f"/select,{path}"]}
    return commands.get(platform, ["xdg-open", str(path.parent)])


def show_in_folder(path: Path) -> None:
    """Show a file in the system's file manager. Raises ``ValueError`` if there is none."""
    try:
        subprocess.Popen(folder_command(path.absolute()), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    except OSError:
        raise ValueError(f"no file manager was found; the file is in {path.absolute().parent}") from None
