import pytest

from core.lab.benchmarks.frames import EXACT, FAST, cases, measure
from core.lab.benchmarks.held_out_views import HeldOutView
from core.models.model import Model
from tests.core.lab.evaluation.test_protocol import views_of


@pytest.mark.usefixtures("rasteriser")
def test_every_renderer_is_timed_against_the_exact_one(tiny: Model):
    timings = measure(HeldOutView(tiny, views_of(tiny, 0, 10)), "24 px")
    renderers = {name: [timing for timing in timings if timing.renderer == name] for name in ("exact", "fast", "baked")}
    assert [timing.samples for timing in renderers["exact"]] == list(EXACT)
    assert [timing.samples for timing in renderers["fast"]] == list(FAST)
    assert [timing.samples for timing in renderers["baked"]] == [64, 128]
    assert all(timing.milliseconds > 0 and timing.n == 24 * 24 for timing in timings)
    assert min(timing.psnr for timing in timings) > 20
    errors = [timing.psnr for timing in renderers["exact"]]
    assert errors == sorted(errors)


def test_quick_cases_are_the_smaller_sizes():
    assert cases(True) == cases(False)[:2]
