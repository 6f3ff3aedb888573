from dataclasses import replace

import pytest

from core.benchmarks import ablations as parts
from core.benchmarks.ablations import WHOLE, Measured, measured
from core.benchmarks.fits import TIMES, Trial
from core.benchmarks.held_out_views import HeldOutView
from core.benchmarks.tables import ablations_table
from core.fitting.fit import FitSettings
from core.models.model import Model
from tests.core.evaluation.test_protocol import views_of
from tests.core.tiny import tiny_model


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> Measured:
    """Three objects, of which each is 10 dB harder than the one before; without the race a fit is 1 dB worse."""

    def fit_view(model: Model, target: HeldOutView, preset: str, settings: FitSettings, seed: int) -> Trial:
        raced = settings.starts > 1
        seconds, psnr = (4.0 if raced else 1.0) * (1 + seed), 50.0 - 10 * seed - (not raced)
        errors = (3.0, 2.0, 0.01)
        return Trial(preset, "a", 0, seconds, *errors, 30.0, psnr, None, None, None, (2.0,) * len(TIMES), False)

    monkeypatch.setattr(parts, "fit_view", fit_view)
    model = tiny_model()
    subjects = [HeldOutView(replace(views_of(model, 0, 2), name=str(index)), 0, model.codes[0]) for index in range(3)]
    *_, last = measured(model, subjects)
    assert isinstance(last, Measured)
    return last


def test_each_part_is_compared_with_the_whole_on_the_same_view(found: Measured) -> None:
    whole, *others = found.parts
    assert (whole.summary.preset, whole.gain, whole.time) == (WHOLE, (0.0, 0.0, 0.0), 1.0)
    (race,) = (part for part in others if "race" in part.summary.preset)
    assert (race.gain, race.time) == ((-1.0, -1.0, -1.0), 0.25)
    assert all(part.gain.mean == 0.0 for part in others if part is not race)


def test_the_table_has_a_row_for_every_part(found: Measured) -> None:
    rows = ablations_table(found).splitlines()[4:]
    assert len(rows) == len(found.parts) == len(parts._PARTS)
    assert rows[0].startswith(f"| {WHOLE} | 1.00 | 2.00° |")
    assert sum("| -1.00 (-1.00 to -1.00) |" in row for row in rows) == 1
