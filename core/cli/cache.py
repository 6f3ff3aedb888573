"""``cache``: files on disk that speed up the next start."""

import argparse

from core.runtime.folders import cache_folder


def cache(chosen: argparse.Namespace) -> None:
    """Run ``cache``: print the folder and the size of each file in it; ``--clear`` removes the files."""
    folder = cache_folder()
    files = sorted(path for path in folder.glob("*/*") if path.is_file())
    print(folder, flush=True)
    for path in files:
        size = path.stat().st_size / 1e6
        if chosen.clear:
            path.unlink(missing_ok=True)
        print(f"{size:.1f} MB  {path.relative_to(folder)}{'  removed' if chosen.clear else ''}", flush=True)
    if not files:
        print("nothing is kept", flush=True)
