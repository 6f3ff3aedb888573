from pathlib import Path

from core.lab.benchmarks.charts import redraw, write
from core.lab.benchmarks.csv_files import Results, read_results
from core.lab.benchmarks.scaling import ScalingPoint
from core.lab.evaluation.statistics import Mean


def test_what_is_written_is_read_and_drawn_again(tmp_path: Path) -> None:
    points = tuple(
        ScalingPoint(
            shapes, 2 * shapes, 27.0, Mean(20 + shapes / 10, 18, 30), Mean(shapes / 10, -1, 3), Mean(0.5, 0.2, 0.8)
        )
        for shapes in (5, 10, 20)
    )
    found = Results({"machine": "a machine", "category": "stools", "tests": "12", "steps": "6000"}, points)
    table = write(tmp_path, "scaling", found)
    assert read_results(tmp_path / "scaling.csv", ScalingPoint) == found
    assert (tmp_path / "scaling.md").read_text() == table and "| 5 | 10 | 27.00 | 20.50 | +0.50 (" in table
    (tmp_path / "scaling.png").unlink()
    assert redraw(tmp_path) == [tmp_path / "scaling.csv"]
    assert (tmp_path / "scaling.png").stat().st_size > 5000
