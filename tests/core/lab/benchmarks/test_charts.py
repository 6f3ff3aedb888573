"""Charts and page of rows that were made up: a few views, cases and levels, as a run that was stopped leaves them."""

from pathlib import Path

import pytest

from core.lab.benchmarks import exports, stability
from core.lab.benchmarks.charts import CHARTS
from core.lab.benchmarks.disentanglement import ExchangeTrial
from core.lab.benchmarks.exports import ExportTrial
from core.lab.benchmarks.fits import CASES, FitTrial
from core.lab.benchmarks.frames import FrameTiming
from core.lab.benchmarks.page import BLOCKS, PAGE, write_page
from core.lab.benchmarks.results import append_rows
from core.lab.benchmarks.stability import StabilityTrial
from core.lab.evaluation.protocol import ViewScore
from tests.conftest import image_size

CONDITIONS = {"commit": "a1", "processor": "p", "date": "2026-11-28"}
OBJECTS = ("chairs", "stool"), ("cars", "van")


def rows(kind: str, name: str) -> dict[str, list]:
    """Return rows of every benchmark for an object; the van was stopped after two fits."""
    identity = (kind, name, 0)
    fits = [
        FitTrial(*identity, case, fit.photos, fit.posed, 64, 5, 4.0, 3.0, 1.0, 28.0, score, False, 0.9, 1.0, 1.0)
        for case, fit in list(CASES.items())[: 2 if name == "van" else None]
        for score in [ViewScore(20.0 + fit.photos, 0.9, 0.8, 0.1)]
    ]
    words = [case.replace(", ", " ").split() for case in stability.cases(True)]
    trials = [
        StabilityTrial(*identity, f"{stressor} {level}, {method}", stressor, float(level), method, 5, 90.0, False)
        for stressor, level, method in words
    ]
    timings = [FrameTiming(*identity, "128 px", 128, "fast", count, 2048, 9.0 * count, 50.0) for count in (32, 192)]
    files = [ExportTrial(*identity, case, 1, 2.0, 0.5) for case in exports.cases(True)]
    exchange = [ExchangeTrial(*identity, "exchange", "partner", 3, 0.0, 30.0, 31.0, 32.0)]
    return {"fits": fits, "stability": trials, "frames": timings, "exports": files, "disentanglement": exchange}


def test_charts_and_page_show_what_was_measured(tmp_path: Path) -> None:
    for kind, name in OBJECTS:
        for benchmark, measured in rows(kind, name).items():
            append_rows(tmp_path / f"{benchmark}.csv", CONDITIONS, measured)
    (tmp_path / PAGE).write_text("".join(f"<!-- {name} -->\n<!-- end -->\n" for name in BLOCKS))
    assert write_page(tmp_path) == [*(tmp_path / f"{name}.png" for name in CHARTS), tmp_path / PAGE]
    assert all(image_size(tmp_path / f"{name}.png")[0] > 400 for name in CHARTS)
    page = (tmp_path / PAGE).read_text()
    assert "| **normal** | 2 | 4.0; 4.0 | 100; 100 | 21.0; 21.0 |" in page
    assert "1: mean object, 21.0 dB; over the level before, biases +0.0 dB. 2: " in page
    assert "of 24 wrong results among 24, the program doubts 0; 0 are wrong and sure" in page
    assert "Not measured yet." not in page


@pytest.mark.parametrize("benchmark", ["fits", "exports"])
def test_a_benchmark_alone_is_drawn(tmp_path: Path, benchmark: str) -> None:
    append_rows(tmp_path / f"{benchmark}.csv", CONDITIONS, rows(*OBJECTS[0])[benchmark])
    names = [name for name, chart in CHARTS.items() if chart.benchmarks == (benchmark,)]
    assert write_page(tmp_path) == [tmp_path / f"{name}.png" for name in names]
