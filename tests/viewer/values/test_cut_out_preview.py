from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from core.photos.detector import Detection
from core.photos.segmentation import CutOut, cut_out
from viewer.values.cut_out_preview import CutOutPreview, has_rival, is_doubtful, outlined, pixels_on_white

_FIRST = Detection((0.2, 0.2, 0.8, 0.8), {"chairs": 0.8, "cars": 0.1})


@pytest.fixture(scope="module")
def cut() -> CutOut:
    image = Image.new("RGBA", (60, 40), "white")
    image.paste((200, 30, 30), (20, 10, 40, 30))
    return cut_out(image)


def test_the_outline_runs_along_the_mask_on_white() -> None:
    mask = np.zeros((40, 60), bool)
    mask[10:30, 20:40] = True
    for scale in (1, 3):
        pixels = np.full((40 * scale, 60 * scale, 3), 9, np.uint8)
        drawn = (outlined(pixels, mask, (1, 2, 3)) == (1, 2, 3)).all(-1)
        assert drawn[20 * scale, 20 * scale] and drawn[10 * scale, 30 * scale]
        assert not drawn[20 * scale, 30 * scale] and not drawn[0, 0]
    full = outlined(np.zeros((8, 8, 3), np.uint8), np.ones((8, 8), bool), (9, 9, 9))
    assert full[0].any() and not full[4, 4].any()  # it is cut off there
    assert not outlined(np.zeros((8, 8, 3), np.uint8), np.zeros((8, 8), bool), (9, 9, 9)).any()
    image = Image.new("RGBA", (64, 32), (10, 20, 30, 0))
    image.putpixel((0, 0), (10, 20, 30, 255))
    assert pixels_on_white(image)[0, 0].tolist() == [10, 20, 30]
    assert pixels_on_white(image)[1, 1].tolist() == [255, 255, 255]
    assert pixels_on_white(image, 16).shape == (8, 16, 3)


def test_a_doubtful_cut_out_has_an_outline_of_another_colour(cut: CutOut) -> None:
    image = Image.fromarray((255 * cut.pixels).astype(np.uint8)).convert("RGBA")
    doubtful = replace(cut, confidence=0.2, detections=(_FIRST,))
    assert is_doubtful(doubtful) and not is_doubtful(cut)
    preview = CutOutPreview.of(image, doubtful)
    assert preview.boxes == (_FIRST.box,)
    far = _FIRST._replace(box=(0.0, 0.0, 0.1, 0.05), scores={"chairs": 0.3, "cars": 0.0})
    assert CutOutPreview.of(image, replace(doubtful, detections=(_FIRST, _FIRST, far))).boxes == (_FIRST.box,) * 2
    assert (preview.pixels[10, 30] != CutOutPreview.of(image, cut).pixels[10, 30]).any()


@pytest.mark.parametrize(("score", "rival"), [(0.79, True), (0.3, False)])
def test_a_rival_is_nearly_as_prominent(cut: CutOut, score: float, rival: bool) -> None:
    second = _FIRST._replace(scores={"chairs": score, "cars": 0.0})
    assert has_rival(replace(cut, white=False, detections=(_FIRST, second))) == rival
    assert not has_rival(replace(cut, white=True, detections=(_FIRST, second)))
    assert not has_rival(replace(cut, white=False, detections=(_FIRST,)))
    assert not has_rival(replace(cut, white=False, detections=()))


def test_a_mask_that_fills_its_box_may_be_a_photo_in_a_frame(cut: CutOut) -> None:
    block = replace(cut, white=False)
    assert is_doubtful(block) and not is_doubtful(cut)
    corner = np.add(*np.mgrid[0:40, 0:60]) < 35
    assert not is_doubtful(replace(block, mask=block.mask & ~corner))
