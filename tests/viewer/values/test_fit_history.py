from pathlib import Path

import pytest
from PIL import Image

from core.fitting.fit import FitStep
from core.models.model import Model
from viewer.values import fit_history
from viewer.values.fit_history import FitHistory, PhotoSource, match_poses


def test_poses_belong_to_the_images_of_their_names(tmp_path: Path) -> None:
    one, other, pose, of_other = (tmp_path / name for name in ("1.png", "2.jpg", "1.TXT", "2.txt"))
    pose.write_text("1 2 3 4 " * 4)
    of_other.write_text("words that describe the photo")
    assert match_poses([one, of_other, other, pose]) == ((PhotoSource(one, pose), PhotoSource(other)), (of_other,))


def test_what_lies_beside_photos_is_left_out(tmp_path: Path) -> None:
    names = ("photo.heic", "photo.mov", "photo.AAE", "license.txt", "Thumbs.db", "pose.txt", "scan", "gone.png")
    paths = {name: tmp_path / name for name in names}
    for path in [*paths.values()][:-1]:
        path.write_text("1 0 0 0 " * 4 if path.name == "pose.txt" else "something")
    Image.new("RGB", (8, 8)).save(paths["scan"], "PNG")  # an image by its content
    sources, others = match_poses([*paths.values()])
    assert [source.path.name for source in sources] == ["photo.heic", "scan", "gone.png"]
    assert all(source.pose is None for source in sources)
    assert [path.name for path in others] == ["photo.mov", "photo.AAE", "license.txt", "Thumbs.db", "pose.txt"]
    assert match_poses([paths["photo.mov"]]) == ((PhotoSource(paths["photo.mov"]),), ())
    with pytest.raises(ValueError, match=r"pose\.txt: there is no image beside it"):
        match_poses([paths["pose.txt"]])


def test_of_very_many_steps_every_other_one_is_kept(model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fit_history, "MAX_STEPS", 8)
    camera, so_far = model.camera(0.0, 0.0), FitHistory()
    for number in range(8):
        so_far = so_far.with_step(FitStep(number, 100, 0, 1.0, 20.0, number, (camera,), model.codes.mean))
    so_far = so_far.with_step(FitStep(8, 100, 0, 1.0, 20.0, 8, (camera,), model.codes.mean))
    assert [step.step for step in so_far.steps] == [0, 2, 4, 6, 8]
    assert so_far.last is so_far.steps[-1]
