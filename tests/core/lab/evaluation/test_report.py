import json
from pathlib import Path

from core.lab.evaluation.protocol import EvaluationProtocol, ObjectScore, PoseScore, format_table, write_report

ESTIMATED = [
    ObjectScore("a", 24.0, 0.9, 250, 4.0, (PoseScore(64, 2.0, 0.01, 80.0, 1.1),)),
    ObjectScore("b", 12.0, 0.7, 250, 6.0, (PoseScore(64, 179.0, 1.99, 90.0, 1.2),)),
]
KNOWN = [ObjectScore("a", 24.0, 0.9, 250, 4.0), ObjectScore("b", 26.0, 0.92, 250, 6.0)]


def test_known_cameras_give_a_row_of_the_papers_table():
    text = format_table(KNOWN, EvaluationProtocol())
    assert "1-view (64), camera known" in text
    assert "25.00 [24.00, 26.00]" in text
    assert "0.910 [0.900, 0.920]" in text
    assert "rotation" not in text
    assert "5.0 s for a fit" in text


def test_estimated_cameras_add_errors_and_outliers_or_a_dash():
    text = format_table(ESTIMATED, EvaluationProtocol((64, 104), estimate=True))
    lines = {line.split("  ")[0].strip(): line for line in text.splitlines()}
    assert "2-view (64, 104), camera estimated" in text
    assert "24.00 [24.00, 24.00]" in next(line for line in text.splitlines() if "- outliers (over" in line)
    assert "90.50" in lines["rotation (degrees)"]
    assert "85.00" in lines["rotation (degrees)"]
    assert "50 [0, 100]" in lines["within 5 degrees (%)"]
    assert " - " in format_table(ESTIMATED[1:], EvaluationProtocol(estimate=True))


def test_the_report_holds_every_object_and_no_nan(tmp_path: Path):
    write_report(tmp_path / "r.json", ESTIMATED[1:], EvaluationProtocol(estimate=True), {"model": "m"})
    text = (tmp_path / "r.json").read_text()
    report = json.loads(text)
    assert "NaN" not in text
    assert report["summary"]["without_outliers"]["psnr"] == [None, None, None]
    assert report["objects"][0]["poses"][0]["rotation"] == 179.0
    assert report["objects"][0]["outlier"]
    assert report["protocol"] == {"inputs": [64], "estimate": True, "preset": "normal", "seed": 0, "every": 1}
