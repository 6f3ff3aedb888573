import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageOps

from core.models.library import sample_images
from core.photos import detector
from core.photos.decode import on_white, read_rgba
from core.photos.detector import UNDETECTED, Detection, box_overlap, detect, detection_of
from core.photos.segmentation import Hints, cut_out


def side_by_side(*paths: Path) -> Image.Image:
    """Samples on one white image."""
    image = Image.new("RGBA", (256 * len(paths), 256), "white")
    for number, path in enumerate(paths):
        sample = Image.open(path).convert("RGBA").resize((256, 256))
        image.alpha_composite(sample, (256 * number, 0))
    return image


@pytest.mark.parametrize("category", ["cars", "chairs"])
def test_samples_are_detected_with_their_category(category: str):
    for path in sample_images(category):
        image = read_rgba(path)
        best, *_ = detect(on_white(image)) or ()
        assert best.category == category
        assert detection_of(cut_out(image).mask, (best,)) is best
        assert sum(best.probabilities.values()) < 1


def test_two_objects_are_detected_and_chosen_by_number_or_point():
    image = side_by_side(sample_images("cars")[0], sample_images("cars")[1])
    detections = [detection for detection in detect(on_white(image)) or () if detection.score > 0.3]
    middles = sorted((detection.box[0] + detection.box[2]) / 2 for detection in detections[:2])
    assert middles[0] < 0.5 < middles[1]
    for number, detection in enumerate(detections[:2]):
        cut = cut_out(image, Hints(object=number))
        assert detection_of(cut.mask, detections) == detection
        left, top, right, bottom = detection.box
        middle = (left + right) / 2, (top + bottom) / 2
        np.testing.assert_array_equal(cut_out(image, Hints(points=(middle,))).mask, cut.mask)
    with pytest.raises(ValueError, match="there is no object 99"):
        cut_out(image, Hints(object=98))


def test_an_object_in_a_box_is_cut_out_of_a_framed_photo():
    """The frame looks like a plain background, and all of the photo like the object."""
    pair = side_by_side(sample_images("cars")[0], sample_images("cars")[1])
    photo = Image.effect_noise(pair.size, 60).convert("RGBA")
    cars = Image.fromarray((255 * cut_out(pair).mask).astype(np.uint8))
    photo.paste(pair.convert("RGB"), (0, 0), cars)
    framed = ImageOps.expand(photo.convert("RGB"), 40, "black").convert("RGBA")
    detections = detect(on_white(framed))
    for detection in detections[:2]:
        assert detection_of(cut_out(framed, Hints(box=detection.box)).mask, detections) == detection


def test_noise_and_a_single_pixel_have_no_detections():
    for size in ((1, 1), (300, 20)):
        assert detect(Image.effect_noise(size, 60).convert("RGB")) == ()
    assert set(UNDETECTED) == {"cars", "chairs"}


def test_a_missing_or_damaged_detector_gives_a_warning_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog):
    detector._detect.cache_clear()
    monkeypatch.setattr(detector, "NETWORKS", tmp_path)
    image = read_rgba(sample_images("cars")[2])
    assert detect(on_white(image)) is None
    (warning,) = caplog.messages
    assert warning.startswith("objects are found without the detector: ssd_oidv4.onnx is missing")
    cut = cut_out(image)
    assert (cut.detections, cut.categories, cut.direction) == ((), {}, None)
    (tmp_path / "ssd_oidv4.onnx").write_bytes(b"damaged")
    caplog.clear()
    assert detect(on_white(image)) is None
    (warning,) = caplog.messages
    assert "ssd_oidv4.onnx cannot be used" in warning
    assert "\n" not in warning


def test_prominence_prefers_large_certain_central_objects():
    usual = Detection((0.3, 0.3, 0.7, 0.7), {"chairs": 0.8, "cars": 0.1})
    smaller = usual._replace(box=(0.45, 0.45, 0.55, 0.55))
    aside = usual._replace(box=(0.0, 0.3, 0.4, 0.7))
    unsure = usual._replace(scores={"chairs": 0.4, "cars": 0.1})
    assert all(usual.prominence > lesser.prominence for lesser in (smaller, aside, unsure))
    assert usual.prominence == pytest.approx(0.8 * math.sqrt(0.4))
    first = (0.0, 0.0, 0.4, 0.4)
    second = (0.2, 0.2, 0.6, 0.6)
    assert box_overlap(first, second) == box_overlap(second, first) == pytest.approx(0.04 / 0.28)
    assert box_overlap(first, (0.5, 0.5, 0.6, 0.6)) == 0
    assert box_overlap((0.5, 0.5, 0.5, 0.5), (0.5, 0.5, 0.5, 0.5)) == 0
