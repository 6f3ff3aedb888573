import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from core.models.library import sample_images
from core.photos import detector
from core.photos.decode import on_white, read_rgba
from core.photos.detector import UNDETECTED, Detection, box_overlap, detect, detection_of
from core.photos.segmentation import Hints, cut_out


def beside_each_other(*paths: Path) -> Image.Image:
    """Samples on one white image."""
    whole = Image.new("RGBA", (256 * len(paths), 256), "white")
    for number, path in enumerate(paths):
        sample = Image.open(path).convert("RGBA").resize((256, 256))
        whole.alpha_composite(sample, (256 * number, 0))
    return whole


@pytest.mark.parametrize("category", ["cars", "chairs"])
def test_samples_are_detected_where_they_are(category: str):
    for path in sample_images(category):
        image = read_rgba(path)
        best, *_ = detect(on_white(image)) or ()
        assert best.category == category
        assert detection_of(cut_out(image).mask, (best,)) is best
        assert sum(best.probabilities.values()) < 1


def test_of_two_objects_both_are_found_and_a_person_chooses():
    image = beside_each_other(sample_images("cars")[0], sample_images("cars")[1])
    found = [one for one in detect(on_white(image)) or () if one.score > 0.3]
    middles = sorted((one.box[0] + one.box[2]) / 2 for one in found[:2])
    assert middles[0] < 0.5 < middles[1]
    for number, one in enumerate(found[:2]):
        cut = cut_out(image, Hints(object=number))
        assert detection_of(cut.mask, found) == one
        (x, y), inside = ((one.box[0] + one.box[2]) / 2, (one.box[1] + one.box[3]) / 2), cut_out
        np.testing.assert_array_equal(inside(image, Hints(points=((x, y),))).mask, cut.mask)
    with pytest.raises(ValueError, match="there is no object 99"):
        cut_out(image, Hints(object=98))


def test_noise_and_a_single_pixel_show_neither():
    for size in ((1, 1), (300, 20)):
        assert detect(Image.effect_noise(size, 60).convert("RGB")) == ()
    assert set(UNDETECTED) == {"cars", "chairs"}


def test_without_its_file_everything_else_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog):
    detector._detect.cache_clear()
    monkeypatch.setattr(detector, "NETWORKS", tmp_path)
    image = read_rgba(sample_images("cars")[2])
    assert detect(on_white(image)) is None
    (said,) = caplog.messages
    assert said.startswith("objects are found without the detector: ssd_oidv4.onnx is missing")
    cut = cut_out(image)
    assert (cut.detections, cut.categories, cut.direction) == ((), {}, None)
    (tmp_path / "ssd_oidv4.onnx").write_bytes(b"damaged")
    caplog.clear()
    assert detect(on_white(image)) is None
    (said,) = caplog.messages
    assert "ssd_oidv4.onnx cannot be used" in said
    assert "\n" not in said


def test_prominent_is_large_sure_and_central_and_boxes_overlap():
    usual = Detection((0.3, 0.3, 0.7, 0.7), {"chairs": 0.8, "cars": 0.1})
    smaller = usual._replace(box=(0.45, 0.45, 0.55, 0.55))
    aside = usual._replace(box=(0.0, 0.3, 0.4, 0.7))
    unsure = usual._replace(scores={"chairs": 0.4, "cars": 0.1})
    assert all(usual.prominence > other.prominence for other in (smaller, aside, unsure))
    assert usual.prominence == pytest.approx(0.8 * math.sqrt(0.4))
    one, other = (0.0, 0.0, 0.4, 0.4), (0.2, 0.2, 0.6, 0.6)
    assert box_overlap(one, other) == box_overlap(other, one) == pytest.approx(0.04 / 0.28)
    assert box_overlap(one, (0.5, 0.5, 0.6, 0.6)) == 0
    assert box_overlap((0.5, 0.5, 0.5, 0.5), (0.5, 0.5, 0.5, 0.5)) == 0
