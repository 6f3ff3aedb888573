"""Numbered boxes of objects in a photo."""

from dataclasses import replace
from pathlib import Path

from core.photos.detector import Detection
from core.photos.segmentation import CutOut, Hints
from tests.viewer.driver import Driver, in_window
from tests.viewer.stand_ins import crowded


def nested(path: Path, hints: Hints | None) -> CutOut:
    """A smaller box whose corner is beside that of a larger one."""
    boxes = (0.1, 0.1, 0.9, 0.9), (0.11, 0.11, 0.5, 0.5)
    detections = tuple(Detection(box, {"chairs": 0.8, "cars": 0.0}) for box in boxes)
    return replace(crowded(path, hints), detections=detections)


@in_window(cut_out=nested)
def test_the_number_of_a_box_is_beside_that_of_a_box_in_its_corner_and_chooses_it(window: Driver, photo: Path) -> None:
    window.ask_about(photo)
    first, second = (window.ctx.item_info(f"//Photo/number {number}").rect_full for number in (1, 2))
    assert second.min.x >= first.max.x
    window.click("Photo/number 1")
    window.wait(lambda: not window.fitting.running)
    assert window.fitting.shown.sources[0].hints.box == (0.1, 0.1, 0.9, 0.9)
