import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.viewer.bombs import BOMBS, write_bomb
from tests.viewer.driver import finish
from viewer.session import Session

_MOST = 500  # MB more than before the file is read

_READ = """
import resource, sys
from pathlib import Path
from core.models.open_models import OpenModels
from tests.conftest import random_model
from viewer.values.project import Project
models = OpenModels(lambda name: random_model())
def megabytes():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // (1024 if sys.platform == "linux" else 1024**2)
Project.load(Path(sys.argv[1]), models)
before = megabytes()
for path in map(Path, sys.argv[2:]):
    try:
        Project.load(path, models)
    except ValueError as error:
        print(f"{path.stem}: {error}")
print(megabytes() - before)
"""


@pytest.fixture
def whole(session: Session, photo: Path, tmp_path: Path) -> Path:
    """A project with a fit."""
    session.fitting.start(photo)
    finish(session, lambda: not session.fitting.running)
    session.project().save(tmp_path / "whole.codenerf", session.models)
    return tmp_path / "whole.codenerf"


@pytest.mark.skipif(sys.platform == "win32", reason="nobody counts memory there")
def test_small_files_that_would_take_gigabytes_are_refused_by_their_bounds(whole: Path, tmp_path: Path) -> None:
    paths = [tmp_path / f"{name}.codenerf" for name in BOMBS]
    for name, path in zip(BOMBS, paths, strict=True):
        write_bomb(name, whole, path)
        assert path.stat().st_size < 1_500_000
    words = [sys.executable, "-c", _READ, whole, *paths]
    done = subprocess.run(words, cwd=Path(__file__).parents[3], capture_output=True, text=True, check=True)
    *lines, megabytes = done.stdout.splitlines()
    for (name, (_, _, said)), line in zip(BOMBS.items(), lines, strict=True):
        assert re.match(rf"{name}: .*{name}\.codenerf: .*{said}", line)
    assert int(megabytes) < _MOST
