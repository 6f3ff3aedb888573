from collections.abc import Iterator
from pathlib import Path

import pytest

from core.lab.benchmarks import rendering
from core.lab.benchmarks.charts import draw
from core.lab.benchmarks.csv_files import append_record, read_records
from core.lab.benchmarks.drawing import prepare
from core.lab.benchmarks.rendering import RenderTiming, measure_rendering, median_turns
from tests.conftest import image_size
from tests.core.tiny import tiny_model

Curves = dict[str, tuple[RenderTiming, ...]]
COMMON = {"machine": "a machine", "views": "2"}


@pytest.fixture(scope="module")
def rows() -> Iterator[list[RenderTiming]]:
    with pytest.MonkeyPatch.context() as changed:
        for name, value in (("TURNS", 2), ("NAIVE_TURNS", 1), ("SIZES", (16, 32)), ("REFERENCE_SAMPLES", 96)):
            changed.setattr(rendering, name, value)
        yield list(measure_rendering(tiny_model(), 2))


@pytest.fixture(scope="module")
def curves(rows: list[RenderTiming]) -> Curves:
    return median_turns(rows)


def test_every_recipe_is_measured_against_the_reference(rows: list[RenderTiming], curves: Curves) -> None:
    naive = curves["naive"]
    fast = curves["fast"]
    assert [point.samples for point in naive] == list(rendering.NAIVE_SAMPLES)
    assert [point.samples for point in fast] == list(rendering.FAST_SAMPLES)
    assert all(point.ms > 0 and point.worst_view <= point.psnr for point in (*naive, *fast))
    assert naive[-1].psnr > naive[0].psnr
    assert min(point.psnr for point in fast) > 45


def test_shortcuts_cost_under_1_db_and_times_are_medians(curves: Curves) -> None:
    full, *ablations = curves["ablation"]
    assert [ablation.recipe for ablation in ablations] == ["without early ray termination", "colouring all intervals"]
    assert all(ablation.psnr == pytest.approx(full.psnr, abs=1.0) for ablation in ablations)
    turns = [RenderTiming("fast", "fast", 128, 64, turn, ms, 50, 49, 0.1) for turn, ms in enumerate((1.0, 9.0, 2.0))]
    (timing,) = median_turns(turns)["fast"]
    assert (timing.ms, timing.psnr) == (2.0, 50.0)


def test_a_resumed_run_goes_on_where_the_first_stopped(rows: list[RenderTiming]) -> None:
    assert len({row.key for row in rows}) == len(rows)
    done = {row.key for row in rows[:-1]}
    assert [row.key for row in measure_rendering(tiny_model(), 2, done)] == [rows[-1].key]


def test_charts_are_written(rows: list[RenderTiming], tmp_path: Path) -> None:
    prepare(tmp_path / "charts")
    path = tmp_path / "charts/render.csv"
    for row in rows:
        append_record(path, COMMON, row)
    assert list(read_records(path, RenderTiming, COMMON)) == rows
    with pytest.raises(ValueError, match=r"render.csv: views '2', and now '3'"):
        read_records(path, RenderTiming, COMMON | {"views": "3"})
    table = draw(tmp_path / "charts", "render")
    assert image_size(tmp_path / "charts/render.png")[0] > 800
    assert (tmp_path / "charts/render.md").read_text() == table
    assert "| naive, float32 | 96 |" in table
