from pathlib import Path

import numpy as np
import pytest
from imgui_bundle import imgui
from PIL import Image

from tests.viewer.driver import Drive, Driver
from viewer.services import clipboard
from viewer.services.clipboard import Clipboard


def test_an_image_is_kept_as_a_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(clipboard.ImageGrab, "grabclipboard", lambda: Image.new("RGBA", (20, 10), "red"))
    board = Clipboard(tmp_path)
    ((first,),) = board.images("")
    ((second,),) = board.images("some words\nand more")
    assert first != second
    with Image.open(first) as image:
        assert image.size == (20, 10)
    monkeypatch.setattr(clipboard.ImageGrab, "grabclipboard", lambda: Image.new("RGB", (2, 1), "red"))
    folder = tmp_path / "pasted"
    ((first,),) = Clipboard(folder).images("")
    board = Clipboard(folder)
    ((second,),) = board.images("")
    assert [path.name for path in (first, second)] == ["pasted 1.png", "pasted 2.png"]
    for _ in range(50):
        ((newest,),) = board.images("")
    assert not (first.exists() or second.exists())
    assert newest.name == "pasted 52.png"
    assert len(list(folder.iterdir())) == 50


def test_the_image_of_the_view_is_copied(drive: Drive, monkeypatch: pytest.MonkeyPatch) -> None:
    copied: list[tuple[bytes, int, int]] = []

    def act(window: Driver) -> None:
        window.wait(lambda: window.session.viewport.sharp)  # no newer picture comes from now on
        monkeypatch.setattr(clipboard.copykitten, "copy_image", lambda *image: copied.append(image))
        window.press(imgui.Key.mod_ctrl, imgui.Key.c)
        ((pixels, width, height),) = copied
        image = window.session.viewport.frame.image
        assert np.array_equal(np.frombuffer(pixels, np.uint8).reshape(height, width, 4)[..., :3], image)

        def refused(*image: object) -> None:
            raise clipboard.copykitten.CopykittenError("no display")

        monkeypatch.setattr(clipboard.copykitten, "copy_image", refused)
        window.menu("Edit/###copy_image")
        assert window.session.messages.errors == ["Cannot copy the image: the clipboard cannot be written (no display)"]

    drive(act)


def test_files_are_named_by_paths_and_addresses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clipboard.ImageGrab, "grabclipboard", lambda: None)
    paths = tmp_path / "a b.png", tmp_path / "c.png"
    for path in paths:
        path.touch()
    assert list(Clipboard().images(f"{paths[0].as_uri()}\r\n{paths[1]}\n")) == [paths]
    for text in ("", "c.png", "x" * 5000, f"{paths[0]}\nmore", "\0"):
        with pytest.raises(ValueError, match="no image"):
            list(Clipboard().images(text))
