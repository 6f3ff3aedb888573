import math
from dataclasses import replace

import pytest

from core.fitting.fit import PRESETS, FitSettings
from core.lab.benchmarks import fits
from core.lab.benchmarks.fits import CASES, FREEDOM, WITHOUT, FitCase, measure, with_directions
from core.lab.benchmarks.held_out_views import HeldOutView
from core.models.model import Model

QUICK_FIT = FitSettings(hypotheses=4, steps=24, rays=96, samples=20, free_steps=3)
CODES = replace(QUICK_FIT, free_steps=0)


@pytest.mark.parametrize(
    ("case", "free"),
    [
        (FitCase(QUICK_FIT, 2, True), 32 * 3),
        (FitCase(CODES, posed=True), 4),
        (FitCase(CODES, posed=True, directions=1), 2),
        (FitCase(CODES, 3, True, 0), 0),
        (FitCase(CODES), 4),
        (FitCase(replace(PRESETS["paper"], steps=4, rays=32, samples=8), posed=True), 4),
    ],
)
def test_a_case_is_fitted_scored_and_has_its_free_numbers(
    view: HeldOutView, case: FitCase, free: int, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(CASES, "tried", case)
    (trial,) = measure(view, "tried")
    assert (trial.category, trial.name, trial.photos, trial.posed) == ("stools", "stool0", case.photos, case.posed)
    assert trial.free == free
    assert trial.novel.psnr > 8 and 0 < trial.novel.overlap <= 1
    assert math.isnan(trial.photo) == (case.directions == 0)
    if case.posed:
        assert trial.rotation < 1e-3 and trial.right == 1 and trial.confidence is None
    else:
        assert 0 <= trial.right <= 1 and 0 < trial.confidence < 1 and trial.margin is not None


def test_few_directions_leave_mean_and_field_alone(tiny: Model):
    limited = with_directions(tiny, 1)
    for space, leading in (
        (tiny.codes.shape_space, limited.codes.shape_space),
        (tiny.codes.texture_space, limited.codes.texture_space),
    ):
        assert leading.mean.equal(space.mean) and leading.std.equal(space.std[:1])
    assert limited.field is tiny.field and limited.mean.codes == tiny.mean.codes


def test_every_component_is_left_out_once_and_free_fits_know_their_cameras():
    usual = FitCase(PRESETS[fits.DEFAULT])
    assert all(case != usual for case in WITHOUT.values())
    assert len(set(WITHOUT.values())) == len(WITHOUT)
    assert all(case.posed for case in FREEDOM.values())
    freed = {name.split(",")[0] for name, case in FREEDOM.items() if case.settings.free_steps}
    assert freed == {"biases", "network"}
