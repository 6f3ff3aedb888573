"""Reports of an evaluation: tables as text, the numbers as JSON, a chart as PNG."""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from PIL import Image

from core.lab.evaluation.disentanglement import PairScore, summarise_pairs
from core.lab.evaluation.protocol import EvaluationProtocol, EvaluationSummary, ObjectScore, PoseSummary, summarise
from core.lab.evaluation.statistics import Mean
from core.runtime.files import atomic_file, is_stream, write_json

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROTATION_BINS = (0, 1, 2, 3, 5, 10, 20, 45, 90, 135, 180)  # degrees
_TRANSLATION_BINS = (0, 1, 2, 3, 5, 10, 20, 50, 100, 200)  # per cent of the distance
_PSNR_BINS = tuple(range(10, 42, 2))  # dB
_SHEET = 24  # pairs on the contact sheet, at most
_FINAL, _INITIAL = "#2f6fb0", "#8cc084"


class _Panel(NamedTuple):
    """A histogram."""

    title: str
    bins: Sequence[int]
    values: Sequence[float]
    initial: Sequence[float] = ()  # the same after the first step of the fit


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
    path: Path, scores: Sequence[ObjectScore], protocol: EvaluationProtocol, about: dict[str, str]
) -> None:
    """Write the numbers as JSON, per object too, with a PNG chart beside it; to a stream the JSON only."""
    objects = [asdict(score) | {"outlier": score.outlier} for score in scores]
    content = about | {"protocol": asdict(protocol), "summary": asdict(summarise(scores)), "objects": objects}
    write_json(path, content)
    if not is_stream(path):
        with suppress(ImportError), atomic_file(path.with_suffix(".png")) as partial:
            chart(scores).savefig(partial)


def chart(scores: Sequence[ObjectScore]) -> "Figure":
    """Draw histograms: PSNR of objects and, for estimated cameras, final and initial errors.

    Raises ``ImportError`` without matplotlib.
    """
    from matplotlib.figure import Figure

    poses = [pose for score in scores for pose in score.poses]
    panels = [_Panel("PSNR (dB), objects", _PSNR_BINS, [score.psnr for score in scores])]
    if poses:
        rotation = [pose.rotation for pose in poses], [pose.initial_rotation for pose in poses]
        translation = [100 * pose.translation for pose in poses], [100 * pose.initial_translation for pose in poses]
        panels.append(_Panel("rotation error (degrees)", _ROTATION_BINS, *rotation))
        panels.append(_Panel("translation error (%)", _TRANSLATION_BINS, *translation))
    figure = Figure(figsize=(4.6 * len(panels), 3.0), layout="constrained")
    for axes, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        _draw_panel(axes, panel)
    return figure


def format_disentanglement(scores: Sequence[PairScore]) -> str:
    """Format scores of held-out and trained pairs, effects of a texture edit, and leaks of codes."""
    found = summarise_pairs(scores)
    rows = (
        ("held-out pairs, codes of two objects", found.recombined, found.recombined_ssim, found.recombined_pairs),
        ("the same, codes fitted to other views", found.refitted, found.refitted_ssim, found.recombined_pairs),
        ("trained pairs, their own codes", found.trained, found.trained_ssim, found.trained_pairs),
    )
    lines = [f"{'':38}{'PSNR (dB)':>22}{'SSIM':>24}{'pairs':>9}"]
    lines += [
        f"{name:38}{_interval(a, 2):>22}{_interval(b, 3):>24}{count:>9}"
        for name, a, b, count in rows
        if not math.isnan(a.mean)
    ]
    lines.append(f"\nanother texture changes the silhouette by at most {found.opacity_change:.2g} of full opacity")
    lines.append(f"and the background by at most {found.background_change:.2g} of full colour")
    if found.probes:
        lines.append(f"\n{'predicted from fitted codes':38}{'correct (%)':>22}{'chance (%)':>24}{'pairs':>9}")
    for name, probe in found.probes.items():
        cells = (_interval(probe.accuracy, 0, 100), f"{100 * probe.chance:.1f}", probe.pairs) if probe else ("-",) * 3
        lines.append(f"{name:38}{cells[0]:>22}{cells[1]:>24}{cells[2]:>9}")
    return "\n".join(lines)


def write_disentanglement_report(path: Path, scores: Sequence[PairScore], about: dict[str, str]) -> None:
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
    write_json(path, about | {"summary": asdict(summarise_pairs(scores)), "pairs": pairs})
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
        found = [getattr(pose, f"initial_{field}"), getattr(pose, field), getattr(without, field) if without else None]
        cells = (_interval(value, 2, scale) if value else "-" for value in found)
        lines.append(f"{name:22}" + "".join(f"{cell:>24}" for cell in cells))
    shares = (("5 degrees", "within_5_degrees"), ("10 degrees", "within_10_degrees"))
    for limit, field in (*shares, ("3 %", "within_3_percent"), ("5 %", "within_5_percent")):
        lines.append(f"{f'within {limit} (%)':22}{'':24}{_interval(getattr(pose, field), 0, 100):>24}")
    return lines


def _counts(values: Sequence[float], bins: Sequence[int]) -> list[int]:
    """Count values per bin; the outer bins include values beyond them."""
    return np.histogram(np.clip(values, bins[0], bins[-1]), bins)[0].tolist()


def _draw_panel(axes: "Axes", panel: _Panel) -> None:
    """Draw a histogram with bars of equal width and counts above them."""
    series = [("final", panel.values, _FINAL), ("initial", panel.initial, _INITIAL)][: 1 + bool(panel.initial)]
    for number, (name, values, colour) in enumerate(series):
        counts, width = _counts(values, panel.bins), 0.8 / len(series)
        lefts = [index + 0.1 + number * width for index in range(len(counts))]
        bars = axes.bar(lefts, counts, width, align="edge", color=colour, label=name)
        axes.bar_label(bars, [str(count or "") for count in counts], fontsize=8)
    axes.set_xticks(range(len(panel.bins)), map(str, panel.bins), fontsize=8)
    axes.set_title(panel.title, fontsize=10)
    axes.set_yticks([])
    if panel.initial:
        axes.legend(fontsize=8)
