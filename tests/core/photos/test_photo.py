import math
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import ExifTags, Image, ImageDraw, ImageOps
from pillow_heif import from_pillow

from core.models.model import Model
from core.photos.decode import read_rgba
from core.photos.photo import Photo, load_photo, prepare_photo
from core.photos.plain_background import NoBackgroundError
from core.photos.segmentation import Hints, cut_out
from core.photos.view_bank import apparent_size
from core.rendering.reference import render_exact
from tests.core.tiny import SIDE, tiny_bank


def drawing(size: tuple[int, int] = (300, 200), background: tuple[int, ...] = (255, 255, 255)) -> Image.Image:
    """A dark thing with a white spot inside, off the middle."""
    image = Image.new("RGB", size, background)
    pen = ImageDraw.Draw(image)
    scale_x = size[0] / 300
    scale_y = size[1] / 200
    pen.rectangle((40 * scale_x, 60 * scale_y, 140 * scale_x, 160 * scale_y), fill=(30, 40, 90))
    pen.ellipse((80 * scale_x, 90 * scale_y, 90 * scale_x, 100 * scale_y), fill=(250, 250, 250))
    return image


def saved(image: Image.Image, path: Path, **options: object) -> Path:
    image.save(path, **options)
    return path


def write_png(path: Path, header: bytes, pixels: bytes, *more: tuple[bytes, bytes]) -> None:
    """Write a PNG chunk by chunk."""
    chunks = [(b"IHDR", header), *more, (b"IDAT", pixels), (b"IEND", b"")]
    encoded = [struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(encoded))


def photo_from(pixels: np.ndarray, model: Model) -> Photo:
    return prepare_photo(cut_out(Image.fromarray(pixels).convert("RGBA")), model)


def check_drawing(photo: Photo, model: Model) -> None:
    """The drawing, in the middle and in the usual size, on white."""
    assert photo.pixels.shape == (SIDE, SIDE, 3)
    assert photo.cropped
    assert photo.camera is None
    rows = photo.mask.any(1).nonzero()[:, 0]
    columns = photo.mask.any(0).nonzero()[:, 0]
    side = apparent_size(tiny_bank(), model).median * SIDE
    assert len(rows) == pytest.approx(side, abs=1.5)
    assert len(columns) == pytest.approx(side, abs=1.5)
    assert float(rows.float().mean()) == pytest.approx(SIDE / 2 - 0.5, abs=1)
    assert float(columns.float().mean()) == pytest.approx(SIDE / 2 - 0.5, abs=1)
    assert bool((photo.pixels[:5] == 1).all())
    colour = photo.pixels[photo.mask].median(0).values
    torch.testing.assert_close(colour, torch.tensor([30, 40, 90]) / 255, atol=0.04, rtol=0)


# Kinds of file


@pytest.mark.parametrize(
    "name, mode",
    [("a.png", "RGB"), ("a.png", "P"), ("a.jpg", "RGB"), ("a.jpg", "CMYK"), ("a.webp", "RGB"), ("a.tif", "RGB")],
)
def test_common_formats_are_cut_out_and_centred(tmp_path: Path, tiny: Model, name: str, mode: str):
    check_drawing(load_photo(saved(drawing().convert(mode), tmp_path / name), tiny), tiny)


@pytest.mark.parametrize("times, orientation", [(1, 1), (1, 6), (10, 6)])
def test_the_focal_length_of_exif_is_kept(tmp_path: Path, tiny: Model, times: int, orientation: int):
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = 52
    image = drawing((300 * times, 200 * times))
    photo = load_photo(saved(image, tmp_path / "a.jpg", exif=exif), tiny)
    scale = 100 / (apparent_size(tiny_bank(), tiny).median * SIDE)  # px of the drawing in one of the crop
    assert photo.scaled
    assert photo.focal == pytest.approx(52 / math.hypot(36, 24) * math.hypot(300, 200) / scale, rel=0.05)
    written = load_photo(saved(image, tmp_path / "b.jpg"), tiny)
    assert written.focal is None


@pytest.mark.parametrize("mode", ["L", "LA", "1", "I;16", "I", "F"])
def test_grey_images_of_any_depth_are_read(tmp_path: Path, tiny: Model, mode: str):
    grey = np.asarray(drawing().convert("L"))
    if mode in ("I;16", "I"):
        image = Image.fromarray(grey.astype(np.uint16) * 257 if mode == "I;16" else grey.astype(np.int32) * 257)
    elif mode == "F":
        image = Image.fromarray(grey.astype(np.float32) / 255)
    else:
        image = Image.fromarray(grey).convert(mode)
    photo = load_photo(saved(image, tmp_path / ("a.tif" if mode in ("I", "F") else "a.png")), tiny)
    assert photo.cropped
    assert float(photo.pixels[photo.mask].mean()) < 0.3


@pytest.mark.parametrize("orientation", range(1, 9))
def test_images_are_turned_upright_as_pillow_turns_them(tmp_path: Path, orientation: int):
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    path = saved(drawing(), tmp_path / "a.png", exif=exif)
    with Image.open(path) as lying:
        np.testing.assert_array_equal(np.asarray(read_rgba(path))[..., :3], np.asarray(ImageOps.exif_transpose(lying)))


def test_transparent_palettes_and_huge_images_are_read(tmp_path: Path, tiny: Model):
    image = drawing(background=(0, 200, 60)).convert("P", palette=Image.Palette.ADAPTIVE)
    check_drawing(load_photo(saved(image, tmp_path / "a.png", transparency=image.getpixel((0, 0))), tiny), tiny)
    image = Image.new("L", (20_000, 1500), 255)
    image.paste(40, (9000, 300, 10_000, 1300))
    photo = load_photo(saved(image, tmp_path / "a.png", compress_level=1), tiny)
    assert photo.pixels.shape == (SIDE, SIDE, 3)
    assert 0.05 < float(photo.mask.float().mean()) < 0.3


def display_p3() -> bytes:
    """A colour profile: primaries and white adapted to D50, as ICC has them, and a gamma of 2.2."""

    def xyz(*values: float) -> bytes:
        return b"XYZ \0\0\0\0" + struct.pack(">3i", *(round(value * 65536) for value in values))

    words = b"Display P3\0"
    tags = {
        b"desc": b"desc\0\0\0\0" + struct.pack(">I", len(words)) + words + bytes(78),
        b"wtpt": xyz(0.9642, 1.0, 0.82491),
        b"rXYZ": xyz(0.51512, 0.2412, -0.00105),
        b"gXYZ": xyz(0.29198, 0.69225, 0.04189),
        b"bXYZ": xyz(0.1571, 0.06657, 0.78407),
    } | dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), b"curv\x00\x00\x00\x00\x00\x00\x00\x01\x023\x00\x00")
    offset = 132 + 12 * len(tags)
    table = struct.pack(">I", len(tags))
    body = b""
    for name, content in tags.items():
        content += bytes(-len(content) % 4)
        table += name + struct.pack(">II", offset + len(body), len(content))
        body += content
    head = struct.pack(">I4sI4s4s4s", offset + len(body), b"lcms", 0x02100000, b"mntr", b"RGB ", b"XYZ ")
    head += bytes(12) + b"acsp" + bytes(28) + struct.pack(">3i", 63190, 65536, 54061)
    return head + bytes(128 - len(head)) + table + body


def test_colours_of_another_space_become_srgb(tmp_path: Path):
    """A square of Display P3's red, as a phone writes it: sRGB's red is (234, 51, 35) there."""
    profile = display_p3()
    for name, mode in (("a.png", "RGBA"), ("a.jpg", "RGB"), ("a.webp", "RGB")):
        image = Image.new(mode, (64, 64), (234, 51, 35, 255)[: len(mode)])
        pixels = np.asarray(read_rgba(saved(image, tmp_path / name, icc_profile=profile, quality=100)))
        np.testing.assert_allclose(pixels[32, 32], (255, 0, 0, 255), atol=12)
        broken = saved(image, tmp_path / name, icc_profile=profile[:300], quality=100)
        np.testing.assert_allclose(np.asarray(read_rgba(broken))[32, 32], (234, 51, 35, 255), atol=6)


def test_large_or_broken_metadata_is_ignored(tmp_path: Path, tiny: Model):
    pixels = zlib.compress(b"".join(b"\0" + row.tobytes() for row in np.asarray(drawing())))
    header = struct.pack(">IIBBBBB", 300, 200, 8, 2, 0, 0, 0)
    large = zlib.compress(bytes(3_000_000))
    for chunk in ((b"iCCP", b"a\0\0" + large), (b"iTXt", b"a\0\1\0\0\0" + large), (b"zTXt", b"a\0\0" + large)):
        write_png(tmp_path / "a.png", header, pixels, chunk)
        check_drawing(load_photo(tmp_path / "a.png", tiny), tiny)
    check_drawing(load_photo(saved(drawing(), tmp_path / "a.jpg", exif=b"Exif\0\0II*\0\xff\xff\xff"), tiny), tiny)


@pytest.mark.parametrize("kind", ["EPS", "DDS", "ICO", "PDF"])
def test_only_formats_of_photographs_are_opened(tmp_path: Path, tiny: Model, kind: str):
    """The suffix does not matter: an EPS file of any name would run PostScript."""
    path = tmp_path / "a.jpg"
    drawing().save(path, kind)
    assert "not an image (PNG" in refused(path, tiny)


# Cut off by an edge


def cut_off(box: tuple[int, int, int, int], tiny: Model) -> Photo:
    """The drawing, cropped to a box."""
    return photo_from(np.asarray(drawing().crop(box)), tiny)


def test_pixels_beyond_a_truncating_edge_are_unseen(tiny: Model):
    photo = cut_off((60, 0, 300, 200), tiny)
    first = int(photo.mask.any(0).nonzero()[0, 0])
    assert bool(photo.unseen[:, : first - 1].all())
    assert not bool(photo.unseen[:, first:].any())
    below = cut_off((0, 0, 300, 150), tiny).unseen
    assert below.any(0).all()
    assert not below[: SIDE // 2].any()


@pytest.mark.parametrize("box", [(0, 0, 300, 200), (40, 60, 141, 161)])
def test_a_complete_or_trimmed_object_has_no_unseen_pixels(tiny: Model, box: tuple[int, int, int, int]):
    cutout = drawing().convert("RGBA")
    cutout.putalpha(Image.fromarray((np.asarray(drawing()).min(-1) < 255).astype(np.uint8) * 255))
    assert photo_from(np.asarray(cutout.crop(box)), tiny).unseen is None


# Separating the object from its background


@pytest.mark.parametrize("background", [(255, 255, 255), (240, 240, 240), (0, 200, 60), (255, 120, 130), (0, 0, 0)])
def test_a_plain_background_of_any_colour_is_removed(tiny: Model, background: tuple[int, ...]):
    photo = photo_from(np.asarray(drawing(background=background)), tiny)
    check_drawing(photo, tiny)


def test_noise_and_uneven_light_are_background(tiny: Model):
    image = np.asarray(drawing(background=(180, 170, 160))).astype(float)
    light = np.linspace(0.85, 1.15, 300)[None, :, None]
    noise = np.random.default_rng(0).normal(0, 2, image.shape)
    plain = (image == [180, 170, 160]).all(-1, keepdims=True)
    lit = np.clip(np.where(plain, image * light, image) + noise, 0, 255).astype(np.uint8)
    check_drawing(photo_from(lit, tiny), tiny)


def test_a_soft_shadow_is_background(tiny: Model):
    y, x = np.mgrid[0:200, 0:300]
    shade = 1 - 0.25 * np.exp(-(((x - 150) / 60.0) ** 2 + ((y - 165) / 25.0) ** 2))
    image = np.asarray(drawing()).astype(float)
    white = (image == 255).all(-1, keepdims=True)
    check_drawing(photo_from(np.where(white, image * shade[..., None], image).astype(np.uint8), tiny), tiny)


def test_enclosed_white_belongs_to_the_object_and_gaps_to_the_background(tiny: Model):
    photo = photo_from(np.asarray(drawing((900, 600))), tiny)
    bright = (photo.pixels > 0.8).all(-1)
    assert bool((bright & photo.mask).any())
    image = Image.new("RGB", (300, 200), (120, 190, 120))
    ImageDraw.Draw(image).rectangle((60, 40, 200, 180), outline=(90, 20, 20), width=25)
    photo = photo_from(np.asarray(image), tiny)
    assert not bool(photo.mask[SIDE // 2, SIDE // 2])
    assert bool((photo.pixels[SIDE // 2, SIDE // 2] == 1).all())


def test_an_alpha_channel_is_the_mask(tiny: Model):
    image = drawing(background=(200, 10, 10)).convert("RGBA")
    values = np.asarray(image).copy()
    values[(values[..., :3] == [200, 10, 10]).all(-1), 3] = 0
    check_drawing(photo_from(values, tiny), tiny)


def test_specks_are_dropped(tiny: Model):
    image = drawing()
    ImageDraw.Draw(image).rectangle((280, 10, 283, 13), fill=(90, 90, 90))
    check_drawing(photo_from(np.asarray(image), tiny), tiny)


# Crop


@pytest.mark.parametrize("azimuth, elevation", [(0.4, 0.3), (2.0, 1.2), (4.0, 0.0)])
def test_a_render_keeps_every_pixel(tmp_path: Path, tiny: Model, azimuth: float, elevation: float):
    frame = render_exact(tiny[1], tiny.camera(azimuth, elevation), 48)
    pixels = (frame.colour.clamp(0, 1) * 255 + 0.5).to(torch.uint8).numpy()
    photo = load_photo(saved(Image.fromarray(pixels), tmp_path / "a.png"), tiny)
    assert not photo.cropped
    inside = frame.opacity > 0.5
    assert bool((photo.pixels[inside] == torch.from_numpy(pixels)[inside] / 255).all())
    assert bool(photo.mask[inside].all())


def test_an_object_too_thin_for_the_model_is_refused(tiny: Model):
    pixels = np.full((1024, 1024, 3), 255, np.uint8)
    pixels[300:720, 300:720] = 0
    pixels[302:718, 302:718] = 255
    with pytest.raises(ValueError, match="too thin"):
        photo_from(pixels, tiny)


@pytest.mark.parametrize("right, down", [(6, 0), (0, -6), (-4, 5)])
def test_a_moved_object_is_recentred_at_its_size(tiny: Model, right: int, down: int):
    frame = render_exact(tiny[1], tiny.camera(0.4, 0.3), 48)
    pixels = (frame.colour.clamp(0, 1).numpy() * 255 + 0.5).astype(np.uint8)
    photo = photo_from(np.roll(pixels, (down, right), (0, 1)), tiny)
    assert photo.cropped
    unmoved = photo_from(pixels, tiny)
    assert not unmoved.cropped
    for axis in (0, 1):
        recentred, original = (framed.mask.any(axis).nonzero()[:, 0] for framed in (photo, unmoved))
        assert abs(int(recentred[0] + recentred[-1]) + 1 - photo.mask.shape[axis]) <= 1
        assert abs(len(recentred) - len(original)) <= 1


def test_with_a_pose_an_image_is_only_resized(tmp_path: Path, tiny: Model):
    camera = tiny.camera(0.4, 0.3)
    pose = tmp_path / "pose.txt"
    pose.write_text(" ".join(str(float(number)) for number in camera.pose().flatten()))
    photo = load_photo(saved(drawing((300, 300)), tmp_path / "a.png"), tiny, pose)
    assert not photo.cropped
    assert photo.camera.azimuth == pytest.approx(0.4)
    assert (photo.camera.width, photo.camera.height, photo.camera.focal) == (SIDE, SIDE, tiny.focal)
    assert float(photo.mask.any(0).nonzero()[0]) == pytest.approx(40 / 300 * SIDE, abs=1)


# Refused files


def refused(path: Path, model: Model, pose: Path | None = None) -> str:
    with pytest.raises(ValueError) as error:
        load_photo(path, model, pose)
    text = str(error.value)
    assert "\n" not in text
    assert str(path) in text or (pose is not None and str(pose) in text)
    return text


def test_files_that_are_no_images_are_refused(tmp_path: Path, tiny: Model):
    text = tmp_path / "text.png"
    text.write_text("not an image")
    assert "not an image" in refused(text, tiny)
    assert "no such image" in refused(tmp_path / "missing.png", tiny)
    assert "is a folder" in refused(tmp_path, tiny)
    (tmp_path / "empty.png").write_bytes(b"")
    assert "not an image" in refused(tmp_path / "empty.png", tiny)
    content = saved(drawing(), tmp_path / "whole.png").read_bytes()
    (tmp_path / "half.png").write_bytes(content[: len(content) // 2])
    assert "not an image that can be read" in refused(tmp_path / "half.png", tiny)


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        *((Image.new("RGB", size), "too small") for size in ((1, 1), (7, 300), (300, 3))),
        (Image.new("RGB", (20_000, 10)), "too narrow (20000 x 10 px)"),
        *(
            (Image.new("RGBA", (90, 90), colour), "no object found")
            for colour in ("white", "black", "green", (9, 9, 9, 0))
        ),
    ],
)
def test_images_that_are_small_narrow_or_of_one_colour_are_refused(
    tmp_path: Path, tiny: Model, image: Image.Image, reason: str
):
    assert reason in refused(saved(image, tmp_path / "a.png"), tiny)


def test_an_object_is_found_in_noise(tmp_path: Path, tiny: Model):
    noise = np.random.default_rng(0).integers(0, 255, (90, 90, 3), dtype=np.uint8)
    assert load_photo(saved(Image.fromarray(noise), tmp_path / "a.png"), tiny).mask.any()


@pytest.mark.parametrize(("side", "bits", "kind"), [(19_900, 16, 0), (13_000, 8, 2), (30_000, 1, 0)])
def test_an_image_of_a_gigabyte_is_refused_by_its_header(tmp_path: Path, tiny: Model, side: int, bits: int, kind: int):
    """An image of black rows, which compress to nearly nothing."""
    packer = zlib.compressobj(1)
    row = bytes(1 + side * bits * (3 if kind else 1) // 8)
    pixels = b"".join(packer.compress(row) for _ in range(20)) + packer.flush()
    write_png(tmp_path / "a.png", struct.pack(">IIBBBBB", side, side, bits, kind, 0, 0, 0), pixels)
    assert f"too large ({side}x{side} px)" in refused(tmp_path / "a.png", tiny)


def test_a_photo_with_inconsistent_fields_is_refused(tiny: Model):
    with pytest.raises((ValueError, TypeError)):
        Photo(torch.ones(8, 8, 3), torch.ones(8, 9, dtype=torch.bool))
    with pytest.raises(ValueError, match="finite"):
        Photo(torch.full((8, 8, 3), float("nan")), torch.ones(8, 8, dtype=torch.bool))
    with pytest.raises(ValueError, match="camera is for"):
        Photo(torch.ones(8, 8, 3), torch.ones(8, 8, dtype=torch.bool), tiny.camera(0.0, 0.0))
    with pytest.raises(ValueError, match="unseen"):
        Photo(torch.zeros(8, 8, 3), torch.ones(8, 8) > 0, unseen=torch.ones(8, 8) > 0)


def test_real_photographs_are_cropped(shared: Path, tiny: Model):
    for name in ("chair_comfort.jpg", "chair_wood.jpg", "chair_watermelon.png"):
        photo = load_photo(shared / "photos" / name, tiny)
        assert photo.cropped
        assert 0.03 < float(photo.mask.float().mean()) < 0.3
    assert load_photo(shared / "photos" / "toyota.jpg", tiny).cropped


def test_a_box_helps_on_a_busy_background(tiny: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("core.photos.candidates.predict_saliency", lambda _: None)
    noise = np.random.default_rng(0).integers(0, 255, (200, 300, 3)).astype(np.uint8)
    noise[60:160, 40:140] = (30, 40, 90)
    path = saved(Image.fromarray(noise), tmp_path / "a.png")
    with pytest.raises(NoBackgroundError, match=r"a\.png"):
        load_photo(path, tiny, hints=Hints((0.0, 0.0, 1.0, 1.0)))
    photo = load_photo(path, tiny, hints=Hints((0.1, 0.25, 0.5, 0.85)))
    colour = photo.pixels[photo.mask].median(0).values
    torch.testing.assert_close(colour, torch.tensor([30, 40, 90]) / 255, atol=0.04, rtol=0)


@pytest.mark.parametrize("suffix", [".heic", ".avif"])
def test_heic_and_avif_are_recognised_by_content(tmp_path: Path, suffix: str):
    image = Image.new("RGB", (64, 48), (200, 30, 30))
    path = tmp_path / "a.jpg"
    if suffix == ".heic":
        from_pillow(image).save(path, format="HEIF")
    else:
        image.save(path, "AVIF")
    pixels = np.asarray(read_rgba(path))
    assert pixels.shape == (48, 64, 4)
    np.testing.assert_allclose(pixels[24, 32], (200, 30, 30, 255), atol=6)
