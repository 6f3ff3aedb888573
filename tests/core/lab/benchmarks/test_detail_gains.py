from dataclasses import replace
from pathlib import Path

from core.lab.benchmarks import charts, detail_gains
from core.lab.benchmarks.csv_files import append_record
from core.lab.benchmarks.detail_gains import DetailView


def rows() -> list[DetailView]:
    """Return views of two objects: detail adds 1 dB to the first, 3 dB to the second."""
    views = []
    for name, gain in (("one", 1.0), ("two", 3.0)):
        photo = DetailView("cars", "own", "found", name, 3, 0.0, 2.0, 0.9, 26.0, 36.0, 36.0, 40.0)
        views.append(photo)
        for view, angle in enumerate((20.0, 100.0)):
            views.append(replace(photo, view=view, angle=angle, plain=24.0, direct=24.0, full=24.0 + gain, bound=None))
    return views


def test_gains_are_means_of_objects() -> None:
    unfitted = detail_gains.unfitted_views(rows())
    assert detail_gains.object_gains(unfitted) == [1.0, 3.0]
    assert detail_gains.gain_by_object(unfitted).mean == 2.0
    assert detail_gains.gain_by_object(unfitted, "direct").mean == 0.0


def test_rows_become_a_table_and_a_chart(tmp_path: Path) -> None:
    for row in rows():
        append_record(tmp_path / "photo_detail.csv", {"machine": "m"}, row)
    table = charts.draw(tmp_path, "photo_detail")
    assert "| cars | own | found | 2 | 24.0 | +2.0" in table
    assert "| 26.0 | 36.0 | 40.0 | 100 %" in table
    assert (tmp_path / "photo_detail.png").stat().st_size > 1000
