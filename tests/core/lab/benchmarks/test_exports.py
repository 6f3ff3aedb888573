import pytest

from core.lab.benchmarks.exports import cases, measure
from core.lab.benchmarks.held_out_views import HeldOutView
from core.models.model import Model
from tests.core.lab.evaluation.test_protocol import views_of


@pytest.mark.parametrize("case", ["stl", "page"])
def test_a_file_has_seconds_and_a_size(tiny: Model, case: str):
    (trial,) = measure(HeldOutView(tiny, views_of(tiny, 0, 10)), case)
    assert trial.seconds > 0 and 0.001 < trial.megabytes < 20


def test_quick_cases_are_a_few():
    assert set(cases(True)) < set(cases(False))
