from dataclasses import replace
from pathlib import Path

import pytest

from core.benchmarks import rendering
from core.benchmarks.charts import prepare, read_rendering, write_rendering
from core.benchmarks.gate import compare_rendering
from core.benchmarks.rendering import RenderingResults, run
from core.benchmarks.tables import rendering_table
from tests.conftest import image_size
from tests.core.tiny import tiny_model


@pytest.fixture(scope="module")
def found() -> RenderingResults:
    patch = pytest.MonkeyPatch()
    with patch.context() as changed:
        for name, value in (
            ("_ROUNDS", 1),
            ("_INTERACTION_FRAMES", 2),
            ("SIZES", (16, 32)),
            ("INTERACTION_SIZES", (24,)),
        ):
            changed.setattr(rendering, name, value)
        changed.setattr(rendering, "REFERENCE_SAMPLES", 96)
        *lines, found = run(tiny_model(), 2)
    assert all(isinstance(line, str) for line in lines)
    assert isinstance(found, RenderingResults)
    return found


def test_every_recipe_is_measured_against_the_reference(found: RenderingResults) -> None:
    assert [point.samples for point in found.naive] == list(rendering.NAIVE_SAMPLES)
    assert [point.samples for point in found.fast] == list(rendering.FAST_SAMPLES)
    assert all(point.ms > 0 and point.worst_view <= point.psnr for point in (*found.naive, *found.fast))
    assert found.naive[-1].psnr > found.naive[0].psnr
    assert min(point.psnr for point in found.fast) > 45
    assert {(one.what, one.size) for one in found.interactions} == {
        (what, 24) for what in ("orbit", "texture", "shape")
    }


def test_what_is_left_out_of_a_ray_costs_next_to_no_accuracy(found: RenderingResults) -> None:
    full, *others = found.ablation
    assert [one.recipe for one in others] == ["without early ray termination", "colouring all intervals"]
    assert all(one.psnr == pytest.approx(full.psnr, abs=1.0) for one in others)


def test_charts_are_written(found: RenderingResults, tmp_path: Path) -> None:
    prepare(tmp_path / "charts")
    write_rendering(found, tmp_path / "charts")
    assert read_rendering(tmp_path / "charts/render.csv") == found
    assert image_size(tmp_path / "charts/render.png")[0] > 800
    table = rendering_table(found)
    assert (tmp_path / "charts/render.md").read_text() == table
    assert "| naive | 96 |" in table


def test_the_gate_compares_ratios_with_a_baseline(found: RenderingResults) -> None:
    assert compare_rendering(found, found) == []
    slow = replace(found, naive=tuple(replace(one, ms=2 * one.ms) for one in found.naive), machine="twice as slow")
    slow = replace(slow, fast=tuple(replace(one, ms=2 * one.ms) for one in found.fast))
    assert compare_rendering(slow, found) == []  # all of it: another machine
    first, *rest = found.fast
    slower = compare_rendering(replace(found, fast=(replace(first, ms=2 * first.ms), *rest)), found)
    assert len(slower) == 1
    assert slower[0].startswith(f"{first.samples} samples: ")
    assert "times faster, baseline" in slower[0]
    (worse,) = compare_rendering(replace(found, fast=(replace(first, psnr=first.psnr - 1), *rest)), found)
    assert "dB (tolerance 0.5 dB)" in worse
