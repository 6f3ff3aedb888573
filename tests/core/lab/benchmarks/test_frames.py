import pytest

from core.lab.benchmarks.frames import EXACT, FAST, measure
from core.lab.benchmarks.held_out_views import HeldOutView


@pytest.mark.usefixtures("rasteriser")
def test_every_renderer_is_timed_against_the_exact_one(view: HeldOutView):
    timings = measure(view, "24 px")
    renderers = {name: [timing for timing in timings if timing.renderer == name] for name in ("exact", "fast", "baked")}
    assert [timing.samples for timing in renderers["exact"]] == list(EXACT)
    assert [timing.samples for timing in renderers["fast"]] == list(FAST)
    assert [timing.samples for timing in renderers["baked"]] == [64, 128]
    assert all(timing.milliseconds > 0 and timing.n == 24 * 24 for timing in timings)
    assert min(timing.psnr for timing in timings) > 20
    errors = [timing.psnr for timing in renderers["exact"]]
    assert errors == sorted(errors)
