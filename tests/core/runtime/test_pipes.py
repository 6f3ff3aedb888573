"""Pipes are inputs of commands, and refused where a file is opened several times."""

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

import core
from core.models.model import Model
from core.models.scene import Scene, scene_model
from core.photos.decode import read_mask
from core.runtime.pipes import as_file

ROOT = Path(__file__).resolve().parents[3]
CUSHION = ROOT / "assets/samples/chairs/cushion.png"
pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    path = tmp_path / "pipe.png"
    os.mkfifo(path)
    return path


def test_the_content_of_a_pipe_is_a_file_afterwards(pipe: Path, tmp_path: Path) -> None:
    copies = []
    for content in (b"first", b"second"):
        writer = threading.Thread(target=pipe.write_bytes, args=(content,))
        writer.start()
        copies.append(as_file(pipe))
        writer.join()
    assert [copy.read_bytes() for copy in copies] == [b"first", b"second"]
    assert {copy.name for copy in copies} == {"pipe.png"}
    for path in (CUSHION, tmp_path, tmp_path / "none", Path("a\0b")):
        assert as_file(path) == path


@pytest.mark.parametrize("source", ["pipe", "/dev/null"])
def test_the_library_refuses_pipes_without_waiting_for_content(source: str, pipe: Path, tiny: Model) -> None:
    path = pipe if source == "pipe" else Path(source)
    readers: list[Callable[[], object]] = [
        lambda: core.load_photo(path, tiny),
        lambda: read_mask(path, CUSHION, (8, 8)),
        lambda: Scene.load(path, tiny),
        lambda: core.load_model(str(path)),
    ]
    for read in readers:
        with pytest.raises(ValueError, match="is a pipe or a device"):
            read()
    assert scene_model(path) is None


def run(words: str, **options: object) -> subprocess.CompletedProcess[bytes]:
    script = f"{sys.executable} -m core {words}"
    return subprocess.run(["bash", "-c", script], cwd=ROOT, capture_output=True, check=True, **options)  # type: ignore[call-overload,no-any-return]


def test_commands_read_photos_masks_scenes_and_models_from_pipes(tmp_path: Path) -> None:
    mask = tmp_path / "mask.png"
    with Image.open(CUSHION) as image:
        grey = image.convert("L").point(lambda value: 255 * (value < 250))
        grey.save(mask)
    scene = tmp_path / "scene.json"
    run(
        f"fit /dev/stdin --mask <(cat {mask}) --preset draft --model <(cat assets/models/chairs.safetensors) "
        f"--out {scene} < <(cat {CUSHION})"
    )
    run(f"render --scene <(cat {scene}) --size 16 --out {tmp_path}/a.png")
    run(f"render --scene /dev/stdin --size 16 --out {tmp_path}/b.png < <(cat {tmp_path}/a.png)")
    with Image.open(tmp_path / "b.png") as image:
        assert image.size == (16, 16)
