from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image, ImageFilter

from core.photos.decode import NOTE, read_mask, read_rgba, upright_size
from core.photos.segmentation import cut_out
from tests.core.photos.test_photo import drawing


def mask_of(image: Image.Image) -> Image.Image:
    """The dark thing of a drawing, white on black."""
    return image.convert("L").point(lambda grey: 255 * (grey < 100))


def inside(mask: Image.Image) -> np.ndarray:
    return np.asarray(mask) > 127


@pytest.mark.parametrize("size", [(300, 200), (150, 100), (301, 200)])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_mask_is_upright_or_turned_as_its_photo_is(orientation: int, size: tuple[int, int], tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    drawing().save(tmp_path / "photo.png", exif=exif)
    photo = read_rgba(tmp_path / "photo.png")
    expected = inside(mask_of(photo.convert("RGB")))
    transposed = orientation >= 5
    mask_of(photo.convert("RGB")).resize(size[::-1] if transposed else size).save(tmp_path / "upright.png")
    mask = read_mask(tmp_path / "upright.png", tmp_path / "photo.png", photo.size)
    assert (inside(mask) == expected).mean() > 0.99
    assert not mask.info[NOTE]
    if transposed:
        mask_of(drawing()).resize(size).save(tmp_path / "lying.png")
        mask = read_mask(tmp_path / "lying.png", tmp_path / "photo.png", photo.size)
        assert (inside(mask) == expected).mean() > 0.99
        assert mask.info[NOTE].startswith("lying.png is turned as photo.png is")


def read_as_mask(image: Image.Image, folder: Path) -> Image.Image:
    """The mask of a drawing that an image is."""
    drawing().save(folder / "photo.png")
    image.save(folder / "mask.png")
    return read_mask(folder / "mask.png", folder / "photo.png", (300, 200))


@pytest.mark.parametrize("size", [(200, 200), (200, 300), (300, 206)])
def test_a_mask_of_other_proportions_is_refused(size: tuple[int, int], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=rf"mask\.png: a mask of {size[0]}x{size[1]} px does not fit .* 300x200 px"):
        read_as_mask(mask_of(drawing()).resize(size), tmp_path)


INSIDE = np.asarray(mask_of(drawing())) > 127
VOC = [0, 0, 0, 128, 0, 0, 0, 128, 0, *[0] * 756, 224, 224, 192]


def in_palette(values: np.ndarray, palette: list[int] | None) -> Image.Image:
    image = Image.fromarray(values)
    if palette:
        image.putpalette(palette)
    return image


def labels(inside: int, outside: int, palette: list[int] | None = None, kind: type = np.uint8) -> Image.Image:
    """A mask that has one value on the object and one beside it, perhaps with a palette."""
    return in_palette(np.where(INSIDE, inside, outside).astype(kind), palette)


def in_two_colours(inside: tuple[int, ...], outside: tuple[int, ...]) -> Image.Image:
    return Image.fromarray(np.where(INSIDE[..., None], inside, outside).astype(np.uint8))


MASKS = {
    "0 and 1": labels(1, 0),
    "0 and 7": labels(7, 0),
    "200 and 255": labels(255, 200),
    "16 bits": labels(1000, 0, kind=np.uint16),
    "one bit": labels(255, 0).convert("1"),
    "red on black": in_two_colours((255, 0, 0), (0, 0, 0)),
    "white on red": in_two_colours((255, 255, 255), (255, 0, 0)),
    "alpha of 0 and 1": in_two_colours((9, 9, 9, 1), (9, 9, 9, 0)),
    "voc": labels(1, 0, VOC),
    "no background class": labels(2, 1, VOC),
    "black has a higher index": labels(0, 1, [200, 0, 0, 0, 0, 0]),
    "white has a lower index": labels(0, 1, [255, 255, 255, 0, 0, 200]),
    "a grey palette": labels(0, 1, [255, 255, 255, 0, 0, 0]),
}


@pytest.mark.parametrize("name", MASKS)
def test_images_of_two_values_are_masks(name: str, tmp_path: Path) -> None:
    np.testing.assert_array_equal(np.asarray(read_as_mask(MASKS[name], tmp_path)), np.where(INSIDE, 255, 0))


def test_pixels_of_unknown_class_are_half_in_the_mask(tmp_path: Path) -> None:
    indices = INSIDE.astype(np.uint8)
    indices[:, 100:104] = 255
    mask = np.asarray(read_as_mask(in_palette(indices, VOC), tmp_path))
    assert (mask[:, 100:104] == 127).all()
    np.testing.assert_array_equal(np.delete(mask, slice(100, 104), 1) > 127, np.delete(INSIDE, slice(100, 104), 1))


@pytest.mark.parametrize(
    ("palette", "values"),
    [(VOC, "3 palette indices"), (None, "3 values"), ([0, 0, 0, 1, 1, 1, 2, 2, 2], "3 values")],
)
def test_a_mask_of_several_objects_lists_them(palette: list[int] | None, values: str, tmp_path: Path) -> None:
    indices = INSIDE.astype(np.uint8)
    indices[:20] = 2
    with pytest.raises(ValueError, match=rf"mask\.png: the mask has {values} \(0, 1, 2\); it must"):
        read_as_mask(in_palette(indices, palette), tmp_path)


def test_photographs_are_no_masks_and_masks_may_have_soft_edges(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"mask\.png: this is no mask: 7\d% of its pixels are neither black nor white"):
        read_as_mask(Image.linear_gradient("L").resize((300, 200)), tmp_path)
    mask = read_as_mask(mask_of(drawing()).filter(ImageFilter.GaussianBlur(6)), tmp_path)
    assert (inside(mask) == INSIDE).mean() > 0.98


@pytest.mark.parametrize("name", ["mask_zero_one", "mask_voc_palette"])
def test_masks_of_zero_and_one_and_of_pascal_voc_are_read(name: str, shared: Path) -> None:
    folder = shared / "failing/5"
    mask = read_mask(folder / f"{name}.png", folder / "mask_photo.png", (640, 480))
    assert inside(mask).sum() == 15346


@pytest.mark.parametrize("sizes", [((32, 24), (300, 200)), ((300, 200), (32, 24)), ((30, 20), (300, 200), (60, 40))])
def test_the_largest_page_of_a_tif_is_read(sizes: tuple[tuple[int, int], ...], tmp_path: Path) -> None:
    first, *further = (drawing(size) for size in sizes)
    first.save(tmp_path / "a.tif", save_all=True, append_images=further)
    image = read_rgba(tmp_path / "a.tif")
    assert image.size == upright_size(tmp_path / "a.tif") == (300, 200)
    assert image.info[NOTE] == f"image {sizes.index((300, 200)) + 1} of the {len(sizes)} in this file is used"
    np.testing.assert_array_equal(np.asarray(image.convert("RGB")), np.asarray(drawing()))


@pytest.mark.parametrize("kind", ["gif", "webp", "png"])
def test_the_first_frame_of_an_animation_is_read(kind: str, tmp_path: Path) -> None:
    white = Image.new("RGB", (300, 200), "white")
    drawing().save(tmp_path / f"a.{kind}", save_all=True, append_images=[white], duration=100, lossless=True)
    image = read_rgba(tmp_path / f"a.{kind}")
    assert inside(mask_of(image.convert("RGB"))).mean() == pytest.approx(inside(mask_of(drawing())).mean(), abs=0.01)
    assert cut_out(image).note == image.info[NOTE] == "image 1 of the 2 in this file is used"


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_grey_of_any_depth_in_16_bits_has_the_same_brightness(bits: int, tmp_path: Path) -> None:
    expected = np.asarray(drawing().convert("L"))
    Image.fromarray(np.round(expected / 255 * (2**bits - 1)).astype(np.uint16)).save(tmp_path / "a.png")
    np.testing.assert_allclose(np.asarray(read_rgba(tmp_path / "a.png").convert("L")), expected, atol=1)


@pytest.mark.parametrize("suffix", [".tiff", ".jpg", ".png", ".webp"])
@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_the_upright_size_is_that_of_the_image_as_read(tmp_path: Path, suffix: str, orientation: int) -> None:
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    path = tmp_path / f"turned{suffix}"
    Image.new("RGB", (30, 20), "red").save(path, exif=exif)
    assert upright_size(path) == read_rgba(path).size
