import struct
from pathlib import Path

import numpy as np
import pillow_heif
import pytest
from PIL import Image, PngImagePlugin

from core.photos.decode import read_rgba

WHITE = 203 / 10_000  # of PQ's range


def ramp() -> np.ndarray:
    """Grey, red, green and blue from black to white, sRGB 0..1."""
    level = np.linspace(0, 1, 64)
    return np.stack([level[:, None] * colour for colour in ((1, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1))]).repeat(8, 0)


def light() -> np.ndarray:
    """The ramp in linear light."""
    srgb = ramp()
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def in_bt2020(linear: np.ndarray) -> np.ndarray:
    return linear @ np.array([(0.6274, 0.3293, 0.0433), (0.0691, 0.9195, 0.0114), (0.0164, 0.0880, 0.8956)]).T


def pq() -> np.ndarray:
    power = (in_bt2020(light()) * WHITE) ** 0.1593017578125
    return ((0.8359375 + 18.8515625 * power) / (1 + 18.6875 * power)) ** 78.84375


def hlg() -> np.ndarray:
    """Encoded for a display of 1000 cd/m2, whose light is the scene's times a power of its luminance."""
    display = in_bt2020(light()) * 0.203
    luminance = (display @ (0.2627, 0.678, 0.0593))[..., None]
    scene = display * np.maximum(luminance, 1e-9) ** (1 / 1.2 - 1)
    logarithm = 0.17883277 * np.log(np.maximum(12 * scene - 0.28466892, 1e-9)) + 0.55991073
    return np.where(scene <= 1 / 12, np.sqrt(3 * scene), logarithm)


def image_of(values: np.ndarray) -> Image.Image:
    return Image.fromarray((values.clip(0, 1) * 255 + 0.5).astype(np.uint8))


def write_png(path: Path, values: np.ndarray, **chunks: bytes) -> Path:
    info = PngImagePlugin.PngInfo()
    for kind, content in chunks.items():
        info.add(kind.encode(), content)
    image_of(values).save(path, pnginfo=info)
    return path


def error(path: Path) -> float:
    """Largest difference from the ramp, 0..255, averaged over the rows of each colour."""
    difference = np.asarray(read_rgba(path))[..., :3] / 1.0 - 255 * ramp()
    return float(np.abs(difference).reshape(4, 8, 64, 3).mean((1, 2, 3)).max())


@pytest.mark.parametrize(
    ("values", "numbers"),
    [
        (pq(), (9, 16)),
        (hlg(), (9, 18)),
        (light(), (1, 8)),
        (light() ** (1 / 2.2), (1, 4)),
        (ramp(), (1, 13)),
        (ramp(), (1, 1)),  # BT.709, which is shown like sRGB
        (ramp(), (2, 2)),  # unspecified
        (ramp(), (99, 16)),  # unknown primaries
    ],
)
def test_a_png_is_read_by_its_colour_numbers(values: np.ndarray, numbers: tuple[int, int], tmp_path: Path):
    path = write_png(tmp_path / "a.png", values, cICP=bytes((*numbers, 0, 1)))
    assert error(path) < 3


@pytest.mark.parametrize(("values", "numbers"), [(pq(), (9, 16)), (ramp(), (1, 13)), (ramp(), (2, 2))])
def test_a_png_of_narrow_range_has_black_at_16_and_white_at_235(
    values: np.ndarray, numbers: tuple[int, int], tmp_path: Path
):
    path = write_png(tmp_path / "a.png", (16 + 219 * values) / 255, cICP=bytes((*numbers, 0, 0)))
    assert error(path) < 3


@pytest.mark.parametrize("gamma", [1.0, 1 / 1.8, 1 / 2.2, 0.0])
def test_a_png_is_read_by_its_gamma(gamma: float, tmp_path: Path):
    values = light() ** gamma if gamma and gamma != 1 / 2.2 else ramp()
    chunk = struct.pack(">I", round(gamma * 100_000))
    assert error(write_png(tmp_path / "a.png", values, gAMA=chunk)) < 3
    assert error(write_png(tmp_path / "b.png", ramp(), gAMA=chunk, sRGB=b"\0")) < 1


@pytest.mark.parametrize(("transfer", "values"), [(16, pq()), (18, hlg())])
def test_a_heif_in_hdr_is_read_by_its_colour_numbers(transfer: int, values: np.ndarray, tmp_path: Path):
    heif = pillow_heif.from_pillow(image_of(values))
    numbers = {"color_primaries": 9, "transfer_characteristics": transfer, "matrix_coefficients": 9}
    heif.save(tmp_path / "a.heif", quality=-1, chroma=444, **numbers)
    assert error(tmp_path / "a.heif") < 5


def test_opacity_is_kept_and_a_damaged_file_is_no_image(tmp_path: Path):
    opaque = np.concatenate((pq(), np.linspace(0, 1, 32)[:, None, None] * np.ones((1, 64, 1))), -1)
    path = write_png(tmp_path / "a.png", opaque, cICP=bytes((9, 16, 0, 1)))
    np.testing.assert_array_equal(np.asarray(read_rgba(path))[..., 3], np.asarray(image_of(opaque))[..., 3])
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(ValueError, match=r"a\.png"):
        read_rgba(path)


@pytest.mark.parametrize("name", ["N1_pq.avif", "N1_hlg.avif", "N1_pq.HIF"])
def test_hdr_photos_that_once_were_dull_are_read(shared: Path, name: str):
    reference = np.asarray(read_rgba(shared / "failing/6/N1_plain.jpg"), float)
    assert np.abs(np.asarray(read_rgba(shared / "failing/6" / name)) - reference).mean() < 4
