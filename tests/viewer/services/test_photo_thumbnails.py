from pathlib import Path

import numpy as np
from PIL import ExifTags, Image

from tests.viewer.driver import finish
from viewer.session import Session


def test_a_photo_is_shown_small_upright_and_whole(session: Session, tmp_path: Path) -> None:
    exif = Image.Exif()
    path = tmp_path / "red.jpg"
    exif[ExifTags.Base.Orientation] = 6  # it lies on its side
    Image.new("RGB", (400, 200), "red").save(path, exif=exif)
    assert session.photo_thumbnails.get(path) is None
    finish(session)
    pixels = session.photo_thumbnails.get(path)
    assert pixels is not None and pixels.shape == (128, 128, 3)
    red = pixels[..., 1] < 100
    assert red[:, 36:92].all() and not red[:, :30].any()
    np.testing.assert_array_equal(pixels[:, 0], 255)
    assert session.photo_thumbnails.get(path) is pixels


def test_a_file_that_is_no_photo_has_no_thumbnail(session: Session, bad_files: dict[str, Path]) -> None:
    for path in bad_files.values():
        session.photo_thumbnails.get(path)
    finish(session)
    assert session.photo_thumbnails.get(bad_files["text.png"]) is None
    assert session.messages.errors == []  # its fit says so
