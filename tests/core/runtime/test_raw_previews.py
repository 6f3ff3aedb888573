"""Camera raws, made here by hand: directories of a TIFF that hold a thumbnail, previews and a sensor's values."""

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from core.photos.decode import NOTE, read_rgba, upright_size
from core.runtime.reading import open_image
from tests.core.photos.test_photo import drawing

Directory = dict[int, tuple[int, ...]]


def jpeg(size: tuple[int, int]) -> bytes:
    file = io.BytesIO()
    drawing(size).save(file, "jpeg", quality=95)
    return file.getvalue()


def write_directory(content: bytearray, entries: Directory) -> int:
    """Append a directory, all of its values numbers of 32 bits, and return its offset."""
    lists = {}
    for tag, values in entries.items():
        if len(values) > 1:
            lists[tag] = len(content)
            content += struct.pack(f"<{len(values)}I", *values)
    offset = len(content)
    content += struct.pack("<H", len(entries))
    for tag, values in sorted(entries.items()):
        content += struct.pack("<HHII", tag, 4, len(values), lists.get(tag, values[0]))
    content += struct.pack("<I", 0)
    return offset


def write_raw(path: Path, preview: tuple[int, int] | None, tags: str, orientation: int = 1) -> None:
    """A raw of 3000 x 2000 px with a thumbnail of 30 x 20."""
    content = bytearray(b"II*\0\0\0\0\0")
    below = []
    sensor = len(content)
    content += b"\xff\xd8\xff\xc3 no image that Pillow reads"
    raw = {254: (0,), 256: (3000,), 257: (2000,), 259: (7,), 262: (32803,), 273: (sensor,), 279: (28,)}
    below.append(write_directory(content, raw))
    if preview:
        offset = len(content)
        data = jpeg(preview)
        content += data
        where = {513: (offset,), 514: (len(data),)} if tags == "nef" else {273: (offset,), 279: (len(data),)}
        sizes = {} if tags == "nef" else {256: (preview[0],), 257: (preview[1],), 259: (7,)}
        below.append(write_directory(content, {254: (1,), **sizes, **where}))
    pixels = np.asarray(drawing((30, 20))).tobytes()
    offset = len(content)
    content += pixels
    first = {254: (1,), 256: (30,), 257: (20,), 258: (8, 8, 8), 259: (1,), 262: (2,), 273: (offset,)}
    first |= {274: (orientation,), 277: (3,), 278: (20,), 279: (len(pixels),), 330: tuple(below)}
    content[4:8] = struct.pack("<I", write_directory(content, first))
    path.write_bytes(content)


@pytest.mark.parametrize("tags", ["nef", "dng"])
@pytest.mark.parametrize("orientation", [1, 6])
def test_the_full_size_preview_of_a_raw_is_read_upright(tags: str, orientation: int, tmp_path: Path) -> None:
    write_raw(tmp_path / "a.dng", (1800, 1200), tags, orientation)
    image = read_rgba(tmp_path / "a.dng")
    assert NOTE not in image.info
    assert image.size == ((1024, 683) if orientation == 1 else (683, 1024))
    assert upright_size(tmp_path / "a.dng") == ((1800, 1200) if orientation == 1 else (1200, 1800))
    expected = drawing((1024, 683)).transpose(Image.Transpose.ROTATE_270) if orientation == 6 else drawing((1024, 683))
    assert np.abs(np.asarray(image.convert("RGB")).astype(int) - np.asarray(expected)).mean() < 2


@pytest.mark.parametrize("preview", [None, (20, 14)])
def test_a_raw_with_only_a_thumbnail_advises_to_export_a_jpeg(preview: tuple[int, int] | None, tmp_path: Path) -> None:
    write_raw(tmp_path / "a.nef", preview, "nef")
    image = read_rgba(tmp_path / "a.nef")
    note = "only the preview of this camera raw is read (30x20 px of 3000x2000): export it as JPEG"
    assert image.info[NOTE] == note
    assert image.size == (30, 20)


def test_a_tiff_of_pages_is_no_raw(tmp_path: Path) -> None:
    drawing().save(tmp_path / "a.tif", save_all=True, append_images=[drawing((600, 400))])
    with open_image(tmp_path / "a.tif") as image:
        assert (image.format, image.size) == ("TIFF", (600, 400))
