"""Reports of an evaluation: tables as text, the numbers as JSON."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from PIL import Image

from core.lab.evaluation.disentanglement import PairScore, summarise_pairs
from core.lab.evaluation.protocol import EvaluationProtocol, EvaluationSummary, ObjectScore, PoseSummary, summarise
from core.lab.evaluation.statistics import Mean
from core.runtime.files import atomic_file, is_stream, write_json

_SHEET = 24  # pairs on the contact sheet, at most


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


def format_disentanglement(scores: Sequence[PairScore]) -> str:
    """Format scores of held-out and trained pairs, effects of a texture edit, and leaks of codes."""
    summary = summarise_pairs(scores)
    rows = (
        ("held-out pairs, codes of two objects", summary.recombined, summary.recombined_ssim, summary.recombined_pairs),
        ("the same, codes fitted to other views", summary.refitted, summary.refitted_ssim, summary.recombined_pairs),
        ("trained pairs, their own codes", summary.trained, summary.trained_ssim, summary.trained_pairs),
    )
    lines = [f"{'':38}{'PSNR (dB)':>22}{'SSIM':>24}{'pairs':>9}"]
    lines += [
        f"{name:38}{_interval(psnr, 2):>22}{_interval(ssim, 3):>24}{count:>9}"
        for name, psnr, ssim, count in rows
        if not math.isnan(psnr.mean)
    ]
    lines.append(f"\nanother texture changes the silhouette by at most {summary.opacity_change:.2g} of full opacity")
    lines.append(f"and the background by at most {summary.background_change:.2g} of full colour")
    if summary.probes:
        lines.append(f"\n{'predicted from fitted codes':38}{'correct (%)':>22}{'chance (%)':>24}{'pairs':>9}")
    for name, probe in summary.probes.items():
        cells = (_interval(probe.accuracy, 0, 100), f"{100 * probe.chance:.1f}", probe.pairs) if probe else ("-",) * 3
        lines.append(f"{name:38}{cells[0]:>22}{cells[1]:>24}{cells[2]:>9}")
    return "\n".join(lines)


def write_disentanglement_report(path: Path, scores: Sequence[PairScore], origin: dict[str, str]) -> None:
    """Write the numbers as JSON, per pair too, and true and rendered views as PNG beside it, held-out pairs first."""
    pairs = [
        {
            "name": score.pair.entry.name,
            "trained": score.pair.trained,
            "psnr": score.psnr,
            "ssim": score.ssim,
            "refitted": score.refitted,
        }
        for score in scores
    ]
    write_json(path, origin | {"summary": asdict(summarise_pairs(scores)), "pairs": pairs})
    if is_stream(path):
        return
    first = sorted(scores, key=lambda score: score.pair.trained)[:_SHEET]
    height, width = first[0].images.shape[:2]
    sheet = Image.new("RGB", (width * min(4, len(first)), height * math.ceil(len(first) / 4)), "white")
    for index, score in enumerate(first):
        sheet.paste(Image.fromarray(score.images), (index % 4 * width, index // 4 * height))
    with atomic_file(path.with_suffix(".png")) as partial:
        sheet.save(partial)


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
