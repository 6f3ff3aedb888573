from dataclasses import replace

import pytest

from core.fitting.settings import ALL_COMPONENTS, PRESETS
from core.lab.benchmarks import fits
from core.lab.benchmarks.ablations import ABLATIONS, FULL, REPEATS, Ablation, summarise_ablations
from core.lab.benchmarks.fits import TIMES, FitMethod, FitTrial
from core.lab.benchmarks.held_out_views import HeldOutView
from core.lab.benchmarks.results import frame_of
from core.lab.benchmarks.tables import ablations_table
from core.models.model import Model
from core.runtime.precision import matmul_dtype
from tests.core.lab.evaluation.test_protocol import views_of
from tests.core.tiny import tiny_model

USED: dict[str, tuple] = {}


@pytest.fixture
def ablations(monkeypatch: pytest.MonkeyPatch) -> tuple[Ablation, ...]:
    """Ablations of three objects, each 10 dB harder than the last; a single hypothesis costs 1 dB."""

    def fit_view(model: Model, target: HeldOutView, preset: str, method: FitMethod, seed: int) -> FitTrial:
        USED[preset] = method.settings, method.components, matmul_dtype("cpu")
        many = method.settings.hypotheses > 1
        index = int(target.views.name)
        seconds = (4.0 if many else 1.0) * (1 + index)
        psnr = 50.0 - 10 * index - (not many)
        errors = (3.0, 2.0, 0.01)
        return FitTrial(
            *(preset, target.views.name, 0, seconds, *errors, 30.0, psnr, not many, 1.0, 1.0, 0.9),
            *((2.0,) * len(TIMES), False),
        )

    monkeypatch.setattr(fits, "fit_view", fit_view)
    model = tiny_model()
    views = [HeldOutView(replace(views_of(model, 0, 2), name=str(index)), 0, model[0]) for index in range(3)]
    return summarise_ablations(frame_of(fits.fit_views(model, views, ABLATIONS)))


def test_each_ablation_differs_from_the_full_fit_and_is_compared_with_it(ablations: tuple[Ablation, ...]) -> None:
    full, *without = ablations
    assert (full.summary.preset, full.gain, full.time) == (FULL, (0.0, 0.0, 0.0), 1.0)
    (single,) = (ablation for ablation in without if "multi-start" in ablation.summary.preset)
    assert (single.gain, single.time) == ((-1.0, -1.0, -1.0), 0.25)
    assert all(ablation.gain.mean == 0.0 for ablation in without if ablation is not single)
    assert USED[FULL][:2] == (PRESETS["normal"], ALL_COMPONENTS)
    different = len(ABLATIONS) - len(REPEATS) + 1
    assert len(set(USED.values())) >= different - (USED["in float32"] == USED[FULL])
    rows = ablations_table(frame_of(ablations, {"machine": "m"})).splitlines()[4:]
    assert len(rows) == len(ablations) == len(ABLATIONS)
    assert rows[0].startswith(f"| {FULL} | 3 | 1.00 | 100 %")
    assert [ablation.summary.restarts for ablation in ablations] == [float(row is single) for row in ablations]
    assert all(ablation.summary.wrong_sure == 0 for ablation in ablations)
    assert sum("| -1.00 (-1.00 to -1.00) |" in row for row in rows) == 1


def test_a_seed_of_the_full_method_is_compared_with_the_other_seeds() -> None:
    trials = [
        FitTrial(name, "a", 0, 1.0, 3.0, 2.0, 0.01, 30.0, psnr, False, None, None, None, (2.0,) * len(TIMES), False)
        for name, psnr in zip((*REPEATS, "in float32"), (20.0, 23.0, 26.0, 25.0), strict=True)
    ]
    assert [ablation.gain.mean for ablation in summarise_ablations(frame_of(trials))] == [-4.5, 0.0, 4.5, 2.0]
