import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from core.photos import decode
from core.photos.decode import NOTE, read_mask, read_rgba, upright_size
from core.photos.segmentation import cut_out
from tests.core.photos.test_photo import drawing, write_png


def mask_of(image: Image.Image) -> Image.Image:
    """The dark thing of a drawing, white on black."""
    return image.convert("L").point(lambda grey: 255 * (grey < 100))


def inside(mask: Image.Image) -> np.ndarray:
    return np.asarray(mask) > 127


@pytest.mark.parametrize("size", [(300, 200), (150, 100), (301, 200)])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_mask_is_taken_upright_or_as_the_pixels_of_its_photo_lie(
    orientation: int, size: tuple[int, int], tmp_path: Path
) -> None:
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    drawing().save(tmp_path / "photo.png", exif=exif)
    photo = read_rgba(tmp_path / "photo.png")
    expected, transposed = inside(mask_of(photo.convert("RGB"))), orientation >= 5
    mask_of(photo.convert("RGB")).resize(size[::-1] if transposed else size).save(tmp_path / "upright.png")
    found = read_mask(tmp_path / "upright.png", tmp_path / "photo.png", photo.size)
    assert (inside(found) == expected).mean() > 0.99
    assert bool(found.info[NOTE]) == (2 <= orientation <= 4)  # it may be meant either way
    if transposed:
        mask_of(drawing()).resize(size).save(tmp_path / "lying.png")
        found = read_mask(tmp_path / "lying.png", tmp_path / "photo.png", photo.size)
        assert (inside(found) == expected).mean() > 0.99
        assert found.info[NOTE].startswith("lying.png is turned as photo.png is")


@pytest.mark.parametrize("size", [(200, 200), (200, 300), (300, 206)])
def test_a_mask_of_other_proportions_is_refused(size: tuple[int, int], tmp_path: Path) -> None:
    drawing().save(tmp_path / "photo.png")
    mask_of(drawing()).resize(size).save(tmp_path / "mask.png")
    with pytest.raises(ValueError, match=rf"mask\.png: a mask of {size[0]}x{size[1]} px does not fit .* 300x200 px"):
        read_mask(tmp_path / "mask.png", tmp_path / "photo.png", (300, 200))


@pytest.mark.parametrize("sizes", [((32, 24), (300, 200)), ((300, 200), (32, 24)), ((30, 20), (300, 200), (60, 40))])
def test_of_the_pages_of_a_tif_the_largest_is_meant(sizes: tuple[tuple[int, int], ...], tmp_path: Path) -> None:
    first, *others = (drawing(size) for size in sizes)
    first.save(tmp_path / "a.tif", save_all=True, append_images=others)
    found = read_rgba(tmp_path / "a.tif")
    assert found.size == upright_size(tmp_path / "a.tif") == (300, 200)
    assert found.info[NOTE] == f"image {sizes.index((300, 200)) + 1} of the {len(sizes)} in this file is used"
    np.testing.assert_array_equal(np.asarray(found.convert("RGB")), np.asarray(drawing()))


def faded(share: float) -> Image.Image:
    return Image.blend(Image.new("RGB", (300, 200), "white"), drawing(), share)


@pytest.mark.parametrize("kind", ["gif", "webp", "png"])
@pytest.mark.parametrize(("shares", "used"), [((0, 0.1, 0.6, 0.9, 1), 4), ((1, 0.8, 0.2), 1), ((0, 0.1, 1, 0), 3)])
def test_of_an_animation_the_first_clear_frame_is_meant(
    kind: str, shares: tuple[float, ...], used: int, tmp_path: Path
) -> None:
    first, *others = map(faded, shares)
    first.save(tmp_path / f"a.{kind}", save_all=True, append_images=others, duration=100, lossless=True)
    found = read_rgba(tmp_path / f"a.{kind}")
    cut = cut_out(found)
    assert inside(mask_of(found.convert("RGB"))).mean() == pytest.approx(inside(mask_of(drawing())).mean(), abs=0.01)
    assert cut.note == found.info[NOTE]
    assert cut.note == f"image {used} of the {len(shares)} in this file is used"


def test_of_an_animation_with_too_many_pixels_the_first_frame_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, *others = map(faded, (0.3, 0.6, 1))
    first.save(tmp_path / "a.gif", save_all=True, append_images=others, duration=100)
    monkeypatch.setattr(decode, "MAX_LOOKED", 300 * 200)
    assert read_rgba(tmp_path / "a.gif").info[NOTE] == "image 1 of the 3 in this file is used"


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
@pytest.mark.parametrize("channels", [1, 3])
def test_images_of_any_depth_in_files_of_16_bits_are_as_bright(bits: int, channels: int, tmp_path: Path) -> None:
    expected = np.asarray(drawing() if channels == 3 else drawing().convert("L"))
    values = np.round(expected / 255 * (2**bits - 1)).astype(">u2")
    header = struct.pack(">IIBBBBB", 300, 200, 16, 2 if channels == 3 else 0, 0, 0, 0)
    write_png(tmp_path / "a.png", header, zlib.compress(b"".join(b"\0" + row.tobytes() for row in values)))
    found = np.asarray(read_rgba(tmp_path / "a.png").convert("RGB" if channels == 3 else "L"))
    np.testing.assert_allclose(found, expected, atol=1)


def test_colours_of_12_bits_keep_their_opacity(tmp_path: Path) -> None:
    colours = np.round(np.asarray(drawing()) / 255 * 4095).astype(">u2")
    opacity = np.where(np.asarray(mask_of(drawing()))[..., None], 65535, 0).astype(">u2")
    rows = np.concatenate((colours, opacity), -1).astype(">u2")
    header = struct.pack(">IIBBBBB", 300, 200, 16, 6, 0, 0, 0)
    write_png(tmp_path / "a.png", header, zlib.compress(b"".join(b"\0" + row.tobytes() for row in rows)))
    found = np.asarray(read_rgba(tmp_path / "a.png"))
    assert ((found[..., 3] > 127) == inside(mask_of(drawing()))).all()
    np.testing.assert_allclose(found[found[..., 3] > 127][:, :3], np.asarray(drawing())[found[..., 3] > 127], atol=1)
