import base64
from io import BytesIO
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from imgui_bundle import imgui
from PIL import Image

from tests.viewer.driver import Drive, Driver, in_window
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


def png() -> bytes:
    file = BytesIO()
    Image.new("RGB", (20, 10), "red").save(file, "PNG")
    return file.getvalue()


BASE64 = base64.b64encode(png()).decode()
ADDRESSES = {
    "base64": f"data:image/png;base64,{BASE64}",
    "without padding": f"data:image/png;base64,{BASE64.rstrip('=')}",
    "with more behind it": f"data:image/png;base64,{BASE64}{'A' * 40_000}",
    "in lines": f"data:image/png;base64,{BASE64[:30]}\r\n{BASE64[30:]}\n",
    "of another kind": f"data:image/jpeg;charset=utf-8;base64,{BASE64}",
    "of no kind": f"data:;base64,{BASE64}",
    "with escapes": f"data:image/png;base64,{quote(BASE64)}",
    "percent": f"data:image/png,{quote(png())}",
}


@pytest.mark.parametrize("address", ADDRESSES.values(), ids=ADDRESSES)
def test_a_data_address_is_the_picture_in_it(address: str, tmp_path: Path) -> None:
    board = Clipboard(tmp_path)
    ((pasted,),) = board.images(address)
    for path in (pasted, board.file(address)):
        assert path.parent == tmp_path and len(path.name) < 30
        with Image.open(path) as image:
            assert image.size == (20, 10)


@pytest.mark.parametrize(
    ("text", "path"),
    [
        ("file://localhost/photos/ein%20stuhl.png", "/photos/ein stuhl.png"),
        ("file:///photos/a%23b.png", "/photos/a#b.png"),
        ("/photos/a%20b.png", "/photos/a%20b.png"),
    ],
)
def test_only_addresses_are_decoded(text: str, path: str) -> None:
    assert Clipboard().file(text) == Path(path)


def test_a_text_too_long_for_a_path_is_refused_in_a_short_line(tmp_path: Path) -> None:
    for text in ("a" * 3_000_000, "https://example.org/" + "b/" * 5000):
        with pytest.raises(ValueError, match="names no file") as caught:
            Clipboard(tmp_path).file(text)
        assert len(str(caught.value)) < 200


@in_window()
def test_long_texts_that_are_dropped_are_told_in_a_line(window: Driver) -> None:
    window.context.drop(["a" * 3_000_000, "data:image/png;base64,AAAA", "/" + "b" * 4000])
    window.wait()
    errors = window.session.messages.errors
    assert len(errors) >= 2 and max(map(len, errors)) <= 400
    assert errors[0].startswith("Cannot take this text: a text of 3,000,000 characters")
