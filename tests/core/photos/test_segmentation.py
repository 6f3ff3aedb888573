import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

from core.photos import candidates
from core.photos.candidates import mask_overlap
from core.photos.decode import read_rgba
from core.photos.photo import DOUBTFUL_MASK
from core.photos.segmentation import Hints, Stroke, cut_out

BOX = (0.2, 0.2, 0.8, 0.8)


def busy(size: int = 240) -> Image.Image:
    """A blue disc before stripes and noise, and a red spot beside it, within the box."""
    random = np.random.default_rng(0)
    background = random.integers(90, 160, (size, size, 3)).astype(np.uint8)
    background[::16] = (240, 200, 40)
    image = Image.fromarray(background)
    pen = ImageDraw.Draw(image)
    pen.ellipse((0.3 * size, 0.3 * size, 0.7 * size, 0.7 * size), fill=(20, 40, 230))
    pen.ellipse((0.68 * size, 0.68 * size, 0.78 * size, 0.78 * size), fill=(230, 20, 20))
    return image.convert("RGBA")


def disc(size: int = 240) -> np.ndarray:
    y, x = np.mgrid[0:size, 0:size] / size
    return np.hypot(x - 0.5, y - 0.5) < 0.2


def test_a_box_and_strokes_find_the_object_on_busy_background():
    cut = cut_out(busy(), Hints(BOX, (Stroke(((0.73, 0.73),), 0.05, False),)))
    assert mask_overlap(cut.mask, disc()) > 0.95
    assert not cut.mask[:40].any()
    np.testing.assert_array_equal(cut.pixels[0], 1)
    assert not cut.white
    adding = Stroke(((0.73, 0.70), (0.73, 0.76)), 0.03, True)
    removing = Stroke(((0.32, 0.5), (0.68, 0.5)), 0.04, False)
    cut = cut_out(busy(), Hints(BOX, (removing, adding)))
    assert cut.mask[175, 175]
    assert not cut.mask[120, 90:150].any()
    again = cut_out(busy(), Hints(BOX, (removing, adding, removing._replace(adds=True))))
    assert again.mask[120, 90:150].all()
    values = np.asarray(busy()).copy()
    values[..., 3] = np.where(disc(), 255, 0)
    assert mask_overlap(cut_out(Image.fromarray(values), Hints(BOX)).mask, disc()) > 0.95


def test_without_a_network_the_middle_is_cut_out_and_strokes_act_locally(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(candidates, "predict_saliency", lambda _: None)
    cut = cut_out(busy())
    assert cut.mask[120, 120]
    assert cut.confidence < 0.9
    with pytest.raises(ValueError, match="no object found"):
        cut_out(Image.new("RGBA", (64, 64), "grey"))
    automatic = cut_out(busy(), Hints(BOX)).mask
    corrected = cut_out(busy(), Hints(BOX, (Stroke(((0.73, 0.73),), 0.05, False),))).mask
    assert automatic[175, 175]
    assert not corrected[170:181, 170:181].any()
    np.testing.assert_array_equal(automatic[:140, :140], corrected[:140, :140])


def test_strokes_correct_an_automatic_mask():
    image = Image.new("RGBA", (240, 240), "white")
    pen = ImageDraw.Draw(image)
    pen.rectangle((40, 40, 100, 200), fill=(20, 40, 230))
    pen.rectangle((140, 40, 200, 200), fill=(230, 40, 20))
    pen.rectangle((100, 110, 140, 116), fill=(90, 40, 120))
    assert cut_out(image).mask[120, 170]
    cut = cut_out(image, Hints(strokes=(Stroke(((0.7, 0.2), (0.7, 0.8)), 0.1, False),)))
    assert cut.mask[120, 70]
    assert not cut.mask[120, 170]


@pytest.mark.parametrize("size", [32, 60, 900])
def test_images_of_any_size_are_cut_out(size: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(candidates, "predict_saliency", lambda _: None)
    cut = cut_out(busy(size), Hints(BOX, (Stroke(((0.73, 0.73),), 0.05, False),)))
    assert cut.mask.shape == (size, size)
    assert mask_overlap(cut.mask, disc(size)) > 0.8


def test_unusable_hints_are_refused():
    with pytest.raises(ValueError, match="empty or outside"):
        Hints((0.5, 0.2, 0.5, 0.8))
    with pytest.raises(ValueError, match="empty or outside"):
        Hints((-0.5, 0.2, 0.5, 0.8))
    with pytest.raises(ValueError, match="removed all"):
        cut_out(busy(), Hints(BOX, (Stroke(((0.0, 0.5), (1.0, 0.5)), 0.5, False),)))
    assert not Hints()


@pytest.fixture
def network(monkeypatch: pytest.MonkeyPatch) -> Callable[[np.ndarray], None]:
    """Makes the saliency network see an object in a given place."""

    def predict(mask: np.ndarray) -> None:
        opacity = mask.astype(np.float32)
        monkeypatch.setattr(candidates, "predict_saliency", lambda _: opacity)
        monkeypatch.setattr(candidates, "network_candidate", lambda *_: candidates.Candidate("network", opacity))

    return predict


def test_the_network_decides_on_busy_backgrounds_skies_frames_and_corners(network: Callable[[np.ndarray], None]):
    network(disc())
    cut = cut_out(busy())
    assert mask_overlap(cut.mask, disc()) > 0.95
    assert not cut.white
    cut = cut_out(landscape())
    assert not cut.mask[200:].any()
    assert mask_overlap(cut.mask, disc()) > 0.95
    network(np.pad(disc(), 30))
    image = Image.new("RGBA", (300, 300), "black")
    image.paste(busy(), (30, 30))
    assert mask_overlap(cut_out(image).mask, np.pad(disc(), 30)) > 0.9
    network(disc())
    image = busy()
    corners = Image.new("L", (240, 240), 0)
    ImageDraw.Draw(corners).rounded_rectangle((0, 0, 239, 239), 20, fill=255)
    image.putalpha(corners)
    assert mask_overlap(cut_out(image).mask, disc()) > 0.9


def two_discs() -> tuple[Image.Image, np.ndarray, np.ndarray]:
    """Two blue discs before noise, and their masks."""
    y, x = np.mgrid[0:240, 0:240] / 240
    left = np.hypot(x - 0.3, y - 0.5) < 0.15
    right = np.hypot(x - 0.7, y - 0.5) < 0.15
    values = np.random.default_rng(0).integers(90, 160, (240, 240, 3)).astype(np.uint8)
    values[left | right] = (20, 40, 230)
    return Image.fromarray(values).convert("RGBA"), left, right


def test_an_uncertain_mask_has_an_alternative(network: Callable[[np.ndarray], None]):
    """Two objects, of which the network sees one: GrabCut's mask, which has both, is one click away."""
    image, left, right = two_discs()
    network(left)
    cut = cut_out(image, Hints((0.1, 0.3, 0.9, 0.7)))
    (second,) = cut.alternatives
    assert second.confidence <= cut.confidence < 0.9
    by_area = sorted((cut, second), key=lambda candidate: candidate.mask.sum())
    assert mask_overlap(by_area[0].mask, left) > 0.9
    assert mask_overlap(by_area[1].mask, left | right) > 0.9
    alternative = cut_out(image, Hints((0.1, 0.3, 0.9, 0.7), choice=1))
    np.testing.assert_array_equal(alternative.mask, second.mask)


def test_points_choose_among_two_objects(monkeypatch: pytest.MonkeyPatch):
    def blue(image: Image.Image) -> np.ndarray:
        return (np.asarray(image.convert("RGB"))[..., 2] > 200).astype(np.float32)

    monkeypatch.setattr(candidates, "predict_saliency", blue)
    image, left, right = two_discs()
    for points, truth in (((0.3, 0.5),), left), (((0.7, 0.5),), right), (((0.3, 0.5), (0.7, 0.5)), left | right):
        assert mask_overlap(cut_out(image, Hints(points=points)).mask, truth) > 0.8
    with pytest.raises(ValueError, match="outside"):
        Hints(points=((1.2, 0.5),))


def test_distant_specks_are_dropped_and_legs_are_kept(network: Callable[[np.ndarray], None]):
    mask = np.zeros((240, 240), bool)
    mask[60:120, 80:160] = mask[124:180, 84:90] = mask[20:40, 210:235] = True
    values = np.asarray(busy()).copy()
    values[mask, :3] = (250, 250, 250)
    network(mask)
    cut = cut_out(Image.fromarray(values))
    assert cut.mask[150, 87]
    assert not cut.mask[20:40, 210:235].any()


def test_a_plain_background_needs_no_saliency_network(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(candidates, "predict_saliency", lambda image: pytest.fail("the network was run"))
    image = np.where(disc()[..., None], (20, 40, 230), (200, 220, 200)).astype(np.uint8)
    assert mask_overlap(cut_out(Image.fromarray(image).convert("RGBA")).mask, disc()) > 0.98


def landscape() -> Image.Image:
    """A plain sky over a road on which a disc stands: the border is mostly sky."""
    image = Image.new("RGBA", (240, 240), (150, 190, 235))
    pen = ImageDraw.Draw(image)
    pen.rectangle((0, 170, 240, 240), fill=(90, 88, 86))
    pen.ellipse((96 - 24, 72, 144 + 24, 168), fill=(200, 30, 30))
    return image


def photograph(size: tuple[int, int] = (200, 160)) -> Image.Image:
    """A red box before a wall that is lit from one side."""
    width, height = size
    x = np.linspace(150, 190, width)[None, :, None] * np.ones((height, 1, 3))
    image = Image.fromarray(x.astype(np.uint8))
    ImageDraw.Draw(image).rectangle((0.3 * width, 0.3 * height, 0.65 * width, 0.8 * height), fill=(180, 20, 20))
    return image


def framed(colour: str, border: tuple[int, int, int, int], jpeg: bool = True) -> Image.Image:
    """In a frame: left, top, right, bottom px."""
    inner = photograph()
    left, top, right, bottom = border
    image = Image.new("RGB", (inner.width + left + right, inner.height + top + bottom), colour)
    image.paste(inner, (left, top))
    if jpeg:
        file = io.BytesIO()
        image.save(file, "JPEG", quality=80)
        return Image.open(file)
    return image


@pytest.mark.parametrize("colour", ["black", "white"])
@pytest.mark.parametrize("jpeg", [False, True])
def test_a_photo_in_a_frame_is_found_within_it(colour: str, jpeg: bool):
    cut = cut_out(framed(colour, (20, 30, 40, 10), jpeg).convert("RGBA"))
    rows = np.flatnonzero(cut.mask.any(1))
    columns = np.flatnonzero(cut.mask.any(0))
    np.testing.assert_allclose(columns[[0, -1]], (20 + 60, 20 + 130), atol=6)
    np.testing.assert_allclose(rows[[0, -1]], (30 + 48, 30 + 128), atol=6)
    assert not cut.white


def test_blocks_of_one_colour_are_objects_and_may_fill_the_image():
    image = Image.new("RGBA", (120, 100), "white")
    ImageDraw.Draw(image).rectangle((20, 20, 90, 80), fill=(180, 20, 20))
    assert cut_out(image).mask.sum() == 71 * 61
    filled = Image.new("L", (200, 100), 0)
    ImageDraw.Draw(filled).rounded_rectangle((1, 1, 198, 98), 4, fill=255)  # its border is clear
    above = Image.new("L", (200, 100), 255)
    ImageDraw.Draw(above).rectangle((0, 0, 199, 30), fill=0)
    for alpha in (filled, above):
        image = Image.new("RGBA", (200, 100), "red")
        image.putalpha(alpha)
        assert cut_out(image).found_by == "alpha channel"


@pytest.mark.parametrize("name", ["police.jpg", "toyota.jpg", "street_suv_a.png", "chair_watermelon.png"])
def test_real_photographs_are_cut_out_without_hints(shared: Path, name: str):
    mask = cut_out(read_rgba(shared / "photos" / name)).mask
    assert 0.1 < mask.mean() < 0.65
    assert mask[[0, -1]].mean() < 0.05


@pytest.mark.parametrize(
    ("box", "inverted", "note"),
    [
        ((40, 30, 160, 110), False, ""),
        ((40, 30, 160, 110), True, "three edges"),
        ((40, 90, 160, 140), True, "three edges"),  # the object is cut off at the bottom
        ((2, 2, 199, 138), False, "96% of the image"),
        ((0, 20, 200, 140), False, ""),  # a sofa that was trimmed
    ],
)
def test_an_inverted_mask_or_one_of_nearly_everything_is_doubtful(box, inverted, note) -> None:
    mask = Image.new("L", (200, 140), 255 * inverted)
    mask.paste(255 * (not inverted), box)
    image = Image.new("RGBA", mask.size, "brown")
    image.putalpha(mask)
    cut = cut_out(image)
    assert (note in cut.note) if note else not cut.note
    assert (cut.confidence < DOUBTFUL_MASK) == bool(note)
