from pathlib import Path

import pytest
from PIL import Image

from viewer.services import clipboard
from viewer.services.clipboard import Clipboard


def test_an_image_is_kept_as_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clipboard.ImageGrab, "grabclipboard", lambda: Image.new("RGBA", (20, 10), "red"))
    board = Clipboard()
    ((first,),) = board.images("")
    ((second,),) = board.images("some words\nand more")
    assert first != second
    with Image.open(first) as image:
        assert image.size == (20, 10)


def test_files_are_named_by_paths_and_addresses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clipboard.ImageGrab, "grabclipboard", lambda: None)
    paths = tmp_path / "a b.png", tmp_path / "c.png"
    for path in paths:
        path.touch()
    assert list(Clipboard().images(f"{paths[0].as_uri()}\r\n{paths[1]}\n")) == [paths]
    for text in ("", "c.png", "x" * 5000, f"{paths[0]}\nmore", "\0"):
        with pytest.raises(ValueError, match="no image"):
            list(Clipboard().images(text))
