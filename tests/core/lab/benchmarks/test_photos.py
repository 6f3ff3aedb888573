import math
from dataclasses import replace
from pathlib import Path

import pytest

from core.fitting.fit import PRESETS
from core.geometry.pixels import bounding_box
from core.lab.benchmarks.photos import Judgement, PhotoTrial, measure_photos, read_judgements
from core.lab.benchmarks.results import frame_of, write_frame
from core.lab.benchmarks.tables import photos_table
from core.models.library import sample_images
from core.photos.decode import read_rgba
from core.photos.segmentation import cut_out


def test_a_photo_is_judged_by_box_category_and_side(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PRESETS, "draft", replace(PRESETS["draft"], hypotheses=2, steps=6, rays=64, samples=16))
    path = sample_images("cars")[0]
    mask = cut_out(read_rgba(path)).mask
    height, width = mask.shape
    left, top, right, bottom = bounding_box(mask)
    box = (left / width, top / height, right / width, bottom / height)
    label = Judgement(path.stem, "cars", *box, azimuth=None, elevation=None)

    def trial_of(*judgements: Judgement) -> PhotoTrial:
        write_frame(tmp_path / "labels.csv", frame_of(judgements))
        (trial,) = measure_photos([path], read_judgements(tmp_path / "labels.csv"), "draft")
        return trial

    corner = replace(label, left=0.0, top=0.0, right=0.01, bottom=0.01, azimuth=0.0, elevation=0.0)
    trial = trial_of(label, corner)
    assert (trial.taken_for, trial.cut_out, trial.right_side) == ("cars", "whole", None)
    again = trial_of(replace(label, azimuth=trial.azimuth + 10, elevation=trial.elevation))
    assert again.right_side
    wrong = trial_of(replace(corner, azimuth=trial.azimuth + 180))
    assert (wrong.cut_out, wrong.right_side) == ("wrong", False)
    assert math.isclose(wrong.confidence, trial.confidence)
    table = photos_table(frame_of((trial, again, wrong), {"preset": "draft", "machine": "here"}))
    assert "3 cars: cut out whole 2, in part 0, wrongly 1; right model 3, right side 1; surest wrong camera" in table
