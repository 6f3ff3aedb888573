"""The object of a video: a dark block before a plain background, seen from a moving camera."""

from collections.abc import Sequence
from pathlib import Path

import pytest
from PIL import Image, ImageDraw

from core.models.model import Model
from core.photos import clip_object
from core.photos.clip_object import ClipCuts, cut_out_clip, load_clip
from core.photos.segmentation import CutOut, cut_out
from core.streams import run_to_end
from tests.core.photos.test_clip import write_clip

SIZE = (96, 64)


def block(left: int | None, background: str = "white") -> Image.Image:
    """A dark block 40 px wide; None: nothing but the background."""
    image = Image.new("RGB", SIZE, background)
    if left is not None:
        ImageDraw.Draw(image).rectangle((left, 12, left + 39, 51), fill=(30, 40, 90))
    return image


def write_blocks(path: Path, lefts: Sequence[int | None]) -> Path:
    """Write a clip that shows each block for a second."""
    return write_clip(path, [block(left) for left in lefts for _ in range(6)], [n / 6 for n in range(6 * len(lefts))])


def cuts_of(path: Path, count: int) -> ClipCuts:
    return run_to_end(cut_out_clip(path, count))


def test_every_frame_with_a_whole_object_is_cut_out(tmp_path: Path) -> None:
    cuts = cuts_of(write_blocks(tmp_path / "walk.mp4", [10, 20, 30]), 3)
    assert cuts.note == ""
    assert [round(float(frame.cut.mask.nonzero()[1].min()), -1) for frame in cuts.frames] == [10, 20, 30]
    assert [frame.name.rpartition(" at ")[0] for frame in cuts.frames] == ["walk.mp4"] * 3


def test_frames_without_the_whole_object_are_left_out_with_a_note(tmp_path: Path) -> None:
    cuts = cuts_of(write_blocks(tmp_path / "walk.mp4", [20, None, -20, 30, 80]), 5)
    assert [round(float(frame.cut.mask.nonzero()[1].min()), -1) for frame in cuts.frames] == [20, 30]
    assert cuts.note.startswith("3 of 5 frames are left out: no object at 1.")
    assert cuts.note.count("the object is cut off at ") == 2


def test_a_clip_without_an_object_gives_one_line(tmp_path: Path) -> None:
    path = write_blocks(tmp_path / "walk.mp4", [None, -20])
    with pytest.raises(ValueError, match=r"walk\.mp4: no frame shows a whole object \(no object at .* s, the object"):
        cuts_of(path, 2)


def test_doubtful_frames_are_left_out_unless_most_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_blocks(tmp_path / "walk.mp4", [10, 20, 30])
    confidences = iter([0.9, 0.3, 0.8, 0.3, 0.2, 0.8])
    monkeypatch.setattr(clip_object, "_is_clear", lambda cut: next(confidences) >= 0.5)
    cuts = cuts_of(path, 3)
    assert [int(frame.name.split()[-2][0]) for frame in cuts.frames] == [0, 2]
    assert cuts.note.startswith("1 of 3 frames are left out: a doubtful cut-out at 1.")
    assert len(cuts_of(path, 3).frames) == 3


def test_frames_share_the_mean_probability_of_categories(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    guesses = iter([{"cars": 0.9, "chairs": 0.1}, {}, {"cars": 0.3, "chairs": 0.5}])

    def guess(image: Image.Image) -> CutOut:
        cut = cut_out(image)
        cut.categories.update(next(guesses))
        return cut

    monkeypatch.setattr(clip_object, "cut_out", guess)
    cuts = cuts_of(write_blocks(tmp_path / "walk.mp4", [10, 20, 30]), 3)
    expected = pytest.approx({"cars": 0.6, "chairs": 0.3})
    assert [frame.cut.categories for frame in cuts.frames] == [expected] * 3


def test_a_clip_is_loaded_as_photos_of_a_model(tmp_path: Path, tiny: Model) -> None:
    photos = load_clip(write_blocks(tmp_path / "walk.mp4", [10, 20]), tiny, 2)
    assert [tuple(photo.mask.shape) for photo in photos] == [(tiny.image_size, tiny.image_size)] * 2
    assert all(photo.camera is None and photo.mask.any() for photo in photos)
