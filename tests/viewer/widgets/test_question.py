from dataclasses import replace
from pathlib import Path

import pytest

from core.photos.detector import UNDETECTED, Detection
from core.photos.photo import read_cut_out
from core.photos.segmentation import CutOut, Hints
from tests.viewer.driver import Driver, in_window
from viewer.values.fit_history import PhotoSource


def throne(path: Path, hints: Hints | None) -> CutOut:
    """Doubtfully cut out, and rather a car than a chair."""
    detection = Detection((0.3, 0.2, 0.7, 0.8), {"chairs": 0.17, "cars": 0.2})
    return replace(read_cut_out(path, hints), confidence=0.2, detections=(detection,), white=False)


@pytest.mark.parametrize("category", ["chairs", "cars"])
@in_window("both", cut_out=throne)
def test_a_doubtful_category_is_chosen_by_a_click_on_its_image(window: Driver, photo: Path, category: str) -> None:
    window.ask_about(photo)
    assert window.fitting.questions[0].words in ("Is it a chair or a car?", "Is it a car or a chair?")
    assert not window.exists("Photo/###this one"), "nothing is taken for granted"
    window.click(f"Photo/as {category}")
    window.wait(lambda: not window.fitting.running)
    assert window.editor.objects.own == ["block"]
    assert window.editor.model.category == category


@in_window(fixture="both", guess_category=lambda cut: {})
def test_a_pointed_out_object_is_asked_for_its_category(window: Driver, photo: Path) -> None:
    window.click("Library/**/show car 1")
    window.fitting.fit(PhotoSource(photo, Hints(box=(0.1, 0.1, 0.9, 0.9))))
    window.wait(lambda: bool(window.fitting.questions))
    window.show("Photo")
    window.click("Photo/as chairs")
    window.wait(lambda: not window.fitting.running)
    assert window.editor.model.category == "chairs"


@in_window(fixture="both", guess_category=lambda cut: UNDETECTED)
def test_none_of_these_is_the_first_answer_where_nothing_looks_like_a_category(window: Driver, photo: Path) -> None:
    window.ask_about(photo)
    assert window.fitting.questions[0].words.startswith("Nothing here looks like a c")
    names = "###leave photo", "###point at it", "as chairs", "as cars"
    corners = [window.ctx.item_info(f"//Photo/{name}").rect_full.min for name in names]
    assert all((corners[0].y, corners[0].x) < (corner.y, corner.x) for corner in corners[1:])
    window.click("Photo/###leave photo")
    assert not window.fitting.pending and not window.fitting.running
    window.ask_about(photo)
    window.click("Photo/as cars")  # a toy that the detector misses
    window.wait(lambda: not window.fitting.running)
    assert window.editor.model.category == "cars"


@in_window()
def test_a_photo_whose_file_is_gone_is_fitted_once_the_file_is_found(window: Driver, photo: Path) -> None:
    moved = photo.with_name("moved.png")
    content = photo.read_bytes()
    photo.unlink()
    window.fitting.fit(PhotoSource(photo))
    window.wait(lambda: bool(window.fitting.questions))
    window.click("Library/**/waits block.png")
    assert not window.exists("Photo/###try again"), "it would fail again"
    window.click("Photo/###find photo")
    assert window.context.files.asking
    moved.write_bytes(content)
    window.session.answers.relocate(window.fitting.questions[0], moved)
    window.wait(lambda: not window.fitting.running)
    assert not window.fitting.pending and window.editor.objects.own == ["moved"]
