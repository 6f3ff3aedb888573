from pathlib import Path

import pytest

from core.fitting.fit import FitStep
from core.models.model import Model
from viewer.values import fit_history as course
from viewer.values.fit_history import Course, Source, paired


def test_poses_belong_to_the_images_of_their_names() -> None:
    found = paired([Path("a/1.png"), Path("b/2.txt"), Path("a/2.jpg"), Path("c/1.TXT")])
    assert found == (Source(Path("a/1.png"), Path("c/1.TXT")), Source(Path("a/2.jpg"), Path("b/2.txt")))
    with pytest.raises(ValueError, match=r"3\.txt"):
        paired([Path("a/1.png"), Path("3.txt")])


def test_of_very_many_steps_every_other_one_is_kept(model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(course, "_MOST_STEPS", 8)
    camera, so_far = model.camera(0.0, 0.0), Course(at=6)
    for number in range(8):
        so_far = so_far.stepped(FitStep(number, 100, 0, 1.0, 20.0, number, (camera,), model.codes.mean))
    looked_at = so_far.step
    so_far = so_far.stepped(FitStep(8, 100, 0, 1.0, 20.0, 8, (camera,), model.codes.mean))
    assert [step.step for step in so_far.steps] == [0, 2, 4, 6, 8]
    assert so_far.step is looked_at
    assert so_far.last is so_far.steps[-1]
