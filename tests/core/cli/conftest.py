"""Commands as a person types them, in this process and in a folder of their own."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from core.__main__ import main
from core.models.model import Model
from tests.core.tiny import SIDE, tiny_model


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which commands are typed."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def file(model: Model, here: Path) -> str:
    model.save(Path("m.safetensors"))
    return "m.safetensors"


@pytest.fixture
def tiny_file(here: Path) -> str:
    tiny_model().save(Path("m.safetensors"))
    return "m.safetensors"


def run(words: str) -> None:
    main(words.split())


def refused(capsys: pytest.CaptureFixture[str], words: str) -> str:
    """Return the message of a wrong call; check that it is one line, with status 2 and nothing on stdout."""
    with pytest.raises(SystemExit) as stopped:
        run(words)
    printed = capsys.readouterr()
    assert stopped.value.code == 2
    assert printed.out == ""
    assert len(printed.err.strip().splitlines()) == 1
    assert "Traceback" not in printed.err
    return printed.err


def draw(path: Path, colour: tuple[int, int, int]) -> None:
    """Draw a block on white."""
    drawing = Image.new("RGB", (SIDE, SIDE), "white")
    drawing.paste(colour, (SIDE // 3, SIDE // 3, 2 * SIDE // 3, 2 * SIDE // 3))
    drawing.save(path)


def write_pose(path: Path, model: Model) -> None:
    """Write the camera of a photo from an azimuth of 60 and an elevation of 20 degrees."""
    pose = model.camera(np.radians(60), np.radians(20)).pose()
    path.write_text(" ".join(map(str, pose.flatten().tolist())))
