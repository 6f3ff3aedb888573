from pathlib import Path

from core.benchmarks.charts import redraw
from core.benchmarks.scaling import ScalingPoint, ScalingResults
from core.benchmarks.tables import scaling_table
from core.benchmarks.training_charts import read_scaling, write_scaling
from core.evaluation.statistics import Mean


def test_what_is_written_is_read_and_drawn_again(tmp_path: Path) -> None:
    points = tuple(
        ScalingPoint(
            shapes, 2 * shapes, 27.0, Mean(20 + shapes / 10, 18, 30), Mean(shapes / 10, -1, 3), Mean(0.5, 0.2, 0.8)
        )
        for shapes in (5, 10, 20)
    )
    found = ScalingResults("a machine", "stools", 12, 6000, points)
    write_scaling(found, tmp_path)
    assert read_scaling(tmp_path / "scaling.csv") == found
    assert (tmp_path / "scaling.md").read_text() == scaling_table(found)
    (tmp_path / "scaling.png").unlink()
    assert redraw(tmp_path) == [tmp_path / "scaling.csv"]
    assert (tmp_path / "scaling.png").stat().st_size > 5000
