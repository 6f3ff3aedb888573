"""The program as a folder that needs no Python: built, and started where there is neither a display nor this source."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

_ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow  # minutes, and 1.3 GB
@pytest.mark.skipif(importlib.util.find_spec("PyInstaller") is None, reason="PyInstaller: pip install -e '.[bundle]'")
def test_the_bundle_starts_and_shows_the_window(tmp_path: Path) -> None:
    folders = ["--distpath", tmp_path / "dist", "--workpath", tmp_path / "work"]
    spec = _ROOT / "viewer" / "bundle.spec"
    subprocess.run([sys.executable, "-m", "PyInstaller", "--log-level=WARN", *folders, spec], cwd=tmp_path, check=True)

    # Neither where Python finds modules, nor which library of windows the toolkit has found for these tests.
    elsewhere = {name: value for name, value in os.environ.items() if not name.startswith("PY")}
    program = tmp_path / "dist" / "codenerf-viewer" / "codenerf-viewer"
    screenshot = tmp_path / "window.png"
    subprocess.run([program, "--screenshot", screenshot], cwd=tmp_path, env=elsewhere, check=True)
    with Image.open(screenshot) as image:
        assert image.size == (1280, 800)
        pixels = np.asarray(image.convert("RGB")).astype(float)
    view = pixels[100:440, 260:870]
    assert (view.max(-1) - view.min(-1)).max() > 60  # a coloured object; all else there is grey
