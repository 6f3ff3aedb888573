"""Reports of an evaluation: tables as text, the numbers as JSON."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from core.lab.evaluation.protocol import EvaluationProtocol, EvaluationSummary, ObjectScore, PoseSummary, summarise
from core.lab.evaluation.statistics import Mean
from core.runtime.files import write_json


def format_table(scores: Sequence[ObjectScore], protocol: EvaluationProtocol) -> str:
    """Format the paper's table and, for estimated cameras, their errors."""
    summary = summarise(scores)
    inputs = f"{len(protocol.inputs)}-view ({', '.join(map(str, protocol.inputs))})"
    name = f"{inputs}, camera {'estimated' if protocol.estimate else 'known'}"
    lines = [f"{'':38}{'PSNR (dB)':>22}{'SSIM':>24}{'objects':>9}", _row(name, summary)]
    if summary.without_outliers:
        lines.append(_row("  - outliers (over 5 degrees or 3 %)", summary.without_outliers))
    lines.append(f"\n{summary.seconds.mean:.1f} s for a fit; 95 % intervals by bootstrap over objects")
    if summary.pose:
        lines += ["", *_pose_table(summary.pose, summary.without_outliers)]
    return "\n".join(lines)


def write_report(
    path: Path, scores: Sequence[ObjectScore], protocol: EvaluationProtocol, origin: dict[str, str]
) -> None:
    """Write the numbers as JSON, per object too."""
    objects = [asdict(score) | {"outlier": score.outlier} for score in scores]
    content = origin | {"protocol": asdict(protocol), "summary": asdict(summarise(scores)), "objects": objects}
    write_json(path, content)


def _row(name: str, summary: EvaluationSummary) -> str:
    return f"{name:38}{_interval(summary.psnr, 2):>22}{_interval(summary.ssim, 3):>24}{summary.objects:>9}"


def _interval(value: Mean, digits: int, scale: float = 1.0) -> str:
    if math.isnan(value.mean):
        return "-"
    mean, low, high = (f"{scale * number:.{digits}f}" for number in value)
    return f"{mean} [{low}, {high}]"


def _pose_table(pose: PoseSummary, kept: EvaluationSummary | None) -> list[str]:
    without = kept.pose if kept and kept.pose else None
    head = f"{pose.cameras} cameras"
    lines = [f"{head:22}{'initial':>24}{'final':>24}{'- outliers':>24}"]
    rows = (("rotation (degrees)", "rotation", 1.0), ("translation (%)", "translation", 100.0))
    for name, field, scale in rows:
        means = [getattr(pose, f"initial_{field}"), getattr(pose, field), getattr(without, field) if without else None]
        cells = (_interval(mean, 2, scale) if mean else "-" for mean in means)
        lines.append(f"{name:22}" + "".join(f"{cell:>24}" for cell in cells))
    limits = (("5 degrees", "within_5_degrees"), ("10 degrees", "within_10_degrees"))
    for limit, field in (*limits, ("3 %", "within_3_percent"), ("5 %", "within_5_percent")):
        lines.append(f"{f'within {limit} (%)':22}{'':24}{_interval(getattr(pose, field), 0, 100):>24}")
    return lines
