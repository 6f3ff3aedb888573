import json
from pathlib import Path

import pytest
from PIL import Image

from core.benchmarks import rendering
from core.benchmarks.charts import prepare, rendering_table, write_rendering
from core.benchmarks.rendering import Measured, measured
from core.rendering import fast as march
from core.rendering import occupancy
from tests.core.tiny import tiny_model


@pytest.fixture(scope="module")
def found() -> Measured:
    patch = pytest.MonkeyPatch()
    with patch.context() as changed:
        for name, value in (("_ROUNDS", 1), ("_DRAGGED", 2), ("SIZES", (16, 32)), ("DRAG_SIZES", (24,))):
            changed.setattr(rendering, name, value)
        changed.setattr(rendering, "REFERENCE_SAMPLES", 96)
        *told, found = measured(tiny_model(), 2)
    assert all(isinstance(line, str) for line in told)
    assert isinstance(found, Measured)
    return found


def test_every_recipe_is_measured_against_the_reference(found: Measured) -> None:
    assert [point.samples for point in found.naive] == list(rendering.NAIVE_SAMPLES)
    assert [point.samples for point in found.fast] == list(rendering.FAST_SAMPLES)
    assert all(point.ms > 0 and point.worst_view <= point.psnr for point in (*found.naive, *found.fast))
    assert found.naive[-1].psnr > found.naive[0].psnr
    assert min(point.psnr for point in found.fast) > 45
    assert {(drag.what, drag.size) for drag in found.drags} == {(what, 24) for what in ("orbit", "texture", "shape")}


def test_leaving_out_a_part_is_undone_afterwards(found: Measured) -> None:
    assert len(found.ablation) == 6
    assert occupancy._MIN_OPACITY > 0
    assert march.tolerances is occupancy.tolerances


def test_charts_are_written(found: Measured, tmp_path: Path) -> None:
    prepare(tmp_path / "charts")
    write_rendering(found, tmp_path / "charts")
    assert json.loads((tmp_path / "charts/render.json").read_text())["views"] == 2
    assert Image.open(tmp_path / "charts/render.png").width > 800
    table = rendering_table(found)
    assert (tmp_path / "charts/render.md").read_text() == table
    assert "| naive | 96 |" in table
