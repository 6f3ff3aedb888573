import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from core.runtime.folders import config_folder, is_temporary

_LINUX = pytest.mark.skipif(sys.platform != "linux", reason="homes of Linux")
_ROOT = Path(__file__).parents[3]


@_LINUX
@pytest.mark.parametrize("home", [None, "/proc", "/dev/null"])
def test_without_a_home_a_temporary_folder_is_used(home: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for name in ("XDG_CONFIG_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    if home is None:
        monkeypatch.setattr("pwd.getpwuid", lambda number: {}[number])  # nobody has this number
    else:
        monkeypatch.setenv("HOME", home)
    folder = config_folder()
    assert folder.parent == tmp_path
    assert is_temporary(folder)
    assert folder.stat().st_mode & 0o777 == 0o700
    assert config_folder() == folder  # and the next time too


@_LINUX
def test_a_home_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "of mine"))
    assert config_folder() == tmp_path / "of mine" / "codenerf-viewer"
    assert not is_temporary(config_folder())


@pytest.mark.skipif(shutil.which("unshare") is None, reason="becomes another user by it")
def test_a_user_number_without_a_name_has_a_folder(tmp_path: Path) -> None:
    number = "54321"
    become = ["unshare", "-U", f"--map-user={number}", f"--map-group={number}"]
    if subprocess.run([*become, "true"], check=False, capture_output=True).returncode:
        pytest.skip("this system lets nobody become another user")
    words = [*become, sys.executable, "-c", "from core.runtime.folders import config_folder; print(config_folder())"]
    environment = {"TMPDIR": str(tmp_path), "PATH": os.environ["PATH"]}
    done = subprocess.run(words, env=environment, cwd=_ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.strip() == str(tmp_path / f"codenerf-viewer-{number}")
