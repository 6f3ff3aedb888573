"""The program as it is called."""

import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from imgui_bundle import glfw_utils
from PIL import Image

import glfw  # isort: skip

from core.models.field import Field
from core.models.model import Model
from tests.viewer.driver import Drive, Driver
from tests.viewer.machine import slowness
from viewer.__main__ import parser
from viewer.services.backend import Backend
from viewer.services.single_instance import Start, begin


def call(*words: object, become: Sequence[str] = (), **environment: str) -> subprocess.CompletedProcess[str]:
    left_out = ("DISPLAY", "WAYLAND_DISPLAY", "XDG_CONFIG_HOME", *(["HOME"] if become else []))
    hidden = {key: value for key, value in os.environ.items() if key not in left_out}
    command = [*become, sys.executable, "-m", "viewer", *map(str, words)]
    root = Path(__file__).resolve().parents[2]
    settings = hidden | {"OMP_NUM_THREADS": "1"} | environment
    limit = 120 * slowness()
    return subprocess.run(command, cwd=root, env=settings, capture_output=True, text=True, timeout=limit, check=False)


@pytest.fixture
def file(tmp_path: Path, model: Model) -> Path:
    """A model of clear air, which is drawn quickly."""
    field = Field(model.field.config)
    torch.nn.init.constant_(field.density_layer.bias, -100.0)
    replace(model, field=field).save(tmp_path / "air.safetensors")
    return tmp_path / "air.safetensors"


_LINUX_ONLY = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere HOME does not name the user's folder")


@_LINUX_ONLY
def test_a_second_start_hands_its_photo_to_the_window(drive: Drive, backend: Backend, photo: Path, tmp_path: Path):
    folder = tmp_path / ".config" / "codenerf-viewer"
    instance = begin(folder, Start())
    assert instance is not None

    def start_again(window: Driver, *words: object) -> subprocess.CompletedProcess[str]:
        done: list[subprocess.CompletedProcess[str]] = []
        threading.Thread(target=lambda: done.append(call(*words, HOME=str(tmp_path)))).start()
        window.wait(lambda: bool(done), 120.0)
        return done[0]

    def act(window: Driver) -> None:
        glfw.iconify_window(glfw_utils.glfw_window_hello_imgui())
        for words in ((), ("--image", photo), ("--model", "cars")):
            done = start_again(window, *words)
            assert (done.returncode, done.stderr) == (0, "")
            assert done.stdout == "CodeNeRF Viewer is open already: its window was raised\n"
            assert not glfw.get_window_attrib(glfw_utils.glfw_window_hello_imgui(), glfw.ICONIFIED)
            window.wait()
        assert window.session.messages.errors == []
        assert [added.name for added in window.session.editor.objects.added] == ["block"]

    with closing(instance):
        drive(act, folder=folder, instance=instance)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there always is a display")
def test_without_a_display_one_line_says_so(tmp_path: Path) -> None:
    done = call(HOME=str(tmp_path))
    assert done.returncode == 1
    assert done.stdout == ""
    assert len(done.stderr.strip().splitlines()) == 1
    assert "no display" in done.stderr
    assert "--screenshot" in done.stderr
    assert not list(tmp_path.rglob("window-*/*.json"))  # the next start finds no window


def test_the_window_is_drawn_without_a_display_and_larger_than_a_screen(tmp_path: Path, file: Path, opengl: None):
    done = call("--model", file, "--screenshot", tmp_path / "w.png", "--size", "2000x1200")
    assert (done.returncode, done.stderr) == (0, "")
    with Image.open(tmp_path / "w.png") as image:
        assert image.size == (2000, 1200)
        assert image.convert("RGB").getcolors(200) is None  # there are more
        shades = [np.asarray(image.convert("L").crop(box)).std() for box in ((0, 0, 400, 100), (1900, 0, 2000, 100))]
    assert min(shades) > 1  # the menu, and what closes the inspector


@_LINUX_ONLY
def test_a_user_without_name_and_home_has_a_window(tmp_path: Path, file: Path, opengl: None) -> None:
    become = ["unshare", "-U", "--map-user=54321", "--map-group=54321"]
    if shutil.which("unshare") is None or subprocess.run([*become, "true"], check=False).returncode:
        pytest.skip("this system lets nobody become another user")
    words = ("--model", file, "--screenshot", tmp_path / "w.png")
    done = call(*words, become=become, TMPDIR=str(tmp_path))
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "w.png").is_file()


def test_errors_are_on_the_screenshot_and_on_stderr(tmp_path: Path, file: Path, opengl: None) -> None:
    (tmp_path / "text.png").write_text("no image")
    done = call(*("--model", file, "--image", tmp_path / "text.png"), *("--screenshot", tmp_path / "w.png"))
    assert done.returncode == 1
    assert len(done.stderr.strip().splitlines()) == 1
    assert "text.png" in done.stderr
    assert (tmp_path / "w.png").is_file()


_PLACES = (
    *(["--screenshot", "a.xyz"], ["--screenshot", "gone/a.png"], ["--screenshot"]),
    *(["--image", "gone.png"], ["--image", "https://a.org/b.png"]),
)


@pytest.mark.parametrize("words", [["--size", "big"], ["--size", "12x8"], ["--what"], *_PLACES])
def test_wrong_words_are_refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        parser().parse_args(words)
    assert ended.value.code == 2
    assert "Traceback" not in capsys.readouterr().err
