from pathlib import Path

import pytest

from core.fitting.fit import FitStep
from core.models.model import Model
from viewer.values import fit_history
from viewer.values.fit_history import FitHistory, PhotoSource, match_poses


def test_poses_belong_to_the_images_of_their_names() -> None:
    found = match_poses([Path("a/1.png"), Path("b/2.txt"), Path("a/2.jpg"), Path("c/1.TXT")])
    assert found == (PhotoSource(Path("a/1.png"), Path("c/1.TXT")), PhotoSource(Path("a/2.jpg"), Path("b/2.txt")))
    with pytest.raises(ValueError, match=r"3\.txt"):
        match_poses([Path("a/1.png"), Path("3.txt")])


def test_of_very_many_steps_every_other_one_is_kept(model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fit_history, "MAX_STEPS", 8)
    camera, so_far = model.camera(0.0, 0.0), FitHistory(selected=6)
    for number in range(8):
        so_far = so_far.with_step(FitStep(number, 100, 0, 1.0, 20.0, number, (camera,), model.codes.mean))
    shown = so_far.step
    so_far = so_far.with_step(FitStep(8, 100, 0, 1.0, 20.0, 8, (camera,), model.codes.mean))
    assert [step.step for step in so_far.steps] == [0, 2, 4, 6, 8]
    assert so_far.step is shown
    assert so_far.last is so_far.steps[-1]
