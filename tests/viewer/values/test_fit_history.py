from pathlib import Path

import pytest
from PIL import Image

from core.fitting.fit import FitStep
from core.models.model import Model
from viewer.values import fit_history
from viewer.values.fit_history import FitHistory, photo_sources


def test_files_that_are_no_photos_are_left_out(tmp_path: Path) -> None:
    names = ("photo.png", "photo.AAE", "license.txt", "Thumbs.db", "scan", "gone.png")
    paths = {name: tmp_path / name for name in names}
    for path in [*paths.values()][:-1]:
        path.write_text("something")
    Image.new("RGB", (8, 8)).save(paths["scan"], "PNG")  # an image by its content
    sources, problems = photo_sources([*paths.values()])
    assert [source.path.name for source in sources] == ["scan"]
    assert {path.name for path in problems} == {*names} - {"scan"}
    assert "gone.png" in str(problems[paths["gone.png"]])


def test_of_very_many_steps_every_other_one_is_kept(model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fit_history, "MAX_STEPS", 8)
    camera = model.camera(0.0, 0.0)
    so_far = FitHistory()
    for number in range(8):
        so_far = so_far.with_step(FitStep(number, 100, 0, 1.0, 20.0, number, (camera,), model.mean))
    so_far = so_far.with_step(FitStep(8, 100, 0, 1.0, 20.0, 8, (camera,), model.mean))
    assert [step.step for step in so_far.steps] == [0, 2, 4, 6, 8]
    assert so_far.last is so_far.steps[-1]
