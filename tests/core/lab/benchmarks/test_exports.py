import pytest

from core.lab.benchmarks.exports import measure
from core.lab.benchmarks.held_out_views import HeldOutView


@pytest.mark.parametrize("case", ["stl", "page"])
def test_a_file_has_seconds_and_a_size(view: HeldOutView, case: str):
    (trial,) = measure(view, case)
    assert trial.seconds > 0 and 0.001 < trial.megabytes < 20
