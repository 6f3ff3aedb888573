from pathlib import Path

import pytest

from core.lab.training.held_out import CurvePoint, read_curve, write_curve


def test_a_curve_is_read_as_written_and_other_files_are_refused(tmp_path: Path) -> None:
    points = [CurvePoint(100, 3.5, 21.25), CurvePoint(200, 7.0, 23.5)]
    write_curve(tmp_path / "m.curve.json", "m", points)
    assert read_curve(tmp_path / "m.curve.json") == points
    assert read_curve(tmp_path / "gone.json") == []
    (tmp_path / "m.curve.json").write_text('{"m": [{"step": 1}]}')
    with pytest.raises(ValueError, match=r"m\.curve\.json: curve\.m\[0\]\.seconds is missing"):
        read_curve(tmp_path / "m.curve.json")
