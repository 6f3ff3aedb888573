"""Reports of an evaluation: tables and histograms as text, the numbers as JSON, a chart as PNG."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

from PIL import Image, ImageDraw

from core.evaluation.disentanglement import PairScore, summarise_pairs
from core.evaluation.protocol import ObjectScore, PoseSummary, Protocol, Summary, summarise
from core.evaluation.statistics import Mean
from core.files import write_json

_ROTATION_BINS = (0, 1, 2, 3, 5, 10, 20, 45, 90, 135, 180)
"""degrees"""
_TRANSLATION_BINS = (0, 1, 2, 3, 5, 10, 20, 50, 100, 200)
"""per cent of the distance"""
_PSNR_BINS = tuple(range(10, 42, 2))
"""dB"""
_SHEET = 24
"""pairs on the contact sheet of a disentanglement report, at the most"""
_FINAL, _INITIAL = "#2f6fb0", "#8cc084"


class _Panel(NamedTuple):
    """A histogram."""

    title: str
    bins: Sequence[int]
    values: Sequence[float]
    initial: Sequence[float] = ()
    """the same after the first step of the fit"""


def format_table(scores: Sequence[ObjectScore], protocol: Protocol) -> str:
    """The paper's table and, where cameras were estimated, their errors as a table and a histogram."""
    summary = summarise(scores)
    inputs = f"{len(protocol.inputs)}-view ({', '.join(map(str, protocol.inputs))})"
    name = f"{inputs}, camera {'estimated' if protocol.estimate else 'known'}"
    lines = [f"{'':38}{'PSNR (dB)':>22}{'SSIM':>24}{'objects':>9}", _row(name, summary)]
    if summary.without_outliers:
        lines.append(_row("  - outliers (over 5 degrees or 3 %)", summary.without_outliers))
    lines.append(f"\n{summary.seconds.mean:.1f} s for a fit; 95 % intervals by bootstrap over objects")
    if summary.pose:
        lines += ["", *_pose_table(summary.pose, summary.without_outliers), "", *_pose_histogram(scores)]
    return "\n".join(lines)


def write_report(path: Path, scores: Sequence[ObjectScore], protocol: Protocol, about: dict[str, str]) -> None:
    """Writes the numbers as JSON, per object too, and a chart as PNG beside it."""
    objects = [asdict(score) | {"outlier": score.outlier} for score in scores]
    content = about | {"protocol": asdict(protocol), "summary": asdict(summarise(scores)), "objects": objects}
    write_json(path, content)
    chart(scores).save(path.with_suffix(".png"))


def chart(scores: Sequence[ObjectScore]) -> Image.Image:
    """Histograms: PSNR of objects and, where cameras were estimated, their errors beside the initial ones."""
    panels = [_Panel("PSNR (dB), objects", _PSNR_BINS, [score.psnr for score in scores])]
    poses = [pose for score in scores for pose in score.poses]
    if poses:
        rotation = [pose.rotation for pose in poses], [pose.initial_rotation for pose in poses]
        translation = [100 * pose.translation for pose in poses], [100 * pose.initial_translation for pose in poses]
        panels.append(_Panel("rotation error (degrees); green: initial", _ROTATION_BINS, *rotation))
        panels.append(_Panel("translation error (%); green: initial", _TRANSLATION_BINS, *translation))
    width, height = 460, 300
    image = Image.new("RGB", (width * len(panels), height), "white")
    for index, panel in enumerate(panels):
        _draw_panel(image, index * width, (width, height), panel)
    return image


def format_disentanglement(scores: Sequence[PairScore]) -> str:
    """Held-out pairs beside trained ones, what a texture edit changes, and what codes leak."""
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
    """Writes the numbers as JSON, per pair too, and beside it, as PNG, true and rendered views, held-out first."""
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
    first = sorted(scores, key=lambda score: score.pair.trained)[:_SHEET]
    height, width = first[0].images.shape[:2]
    sheet = Image.new("RGB", (width * min(4, len(first)), height * math.ceil(len(first) / 4)), "white")
    for index, score in enumerate(first):
        sheet.paste(Image.fromarray(score.images), (index % 4 * width, index // 4 * height))
    sheet.save(path.with_suffix(".png"))


def _row(name: str, summary: Summary) -> str:
    return f"{name:38}{_interval(summary.psnr, 2):>22}{_interval(summary.ssim, 3):>24}{summary.objects:>9}"


def _interval(value: Mean, digits: int, scale: float = 1.0) -> str:
    if math.isnan(value.mean):
        return "-"
    mean, low, high = (f"{scale * number:.{digits}f}" for number in value)
    return f"{mean} [{low}, {high}]"


def _pose_table(pose: PoseSummary, kept: Summary | None) -> list[str]:
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


def _pose_histogram(scores: Sequence[ObjectScore]) -> list[str]:
    poses = [pose for score in scores for pose in score.poses]
    final = _counts([pose.rotation for pose in poses], _ROTATION_BINS)
    initial = _counts([pose.initial_rotation for pose in poses], _ROTATION_BINS)
    scale = min(1.0, 50 / max(final + initial))
    lines = ["rotation error (degrees): # final, . initial"]
    for low, high, after, before in zip(_ROTATION_BINS, _ROTATION_BINS[1:], final, initial, strict=False):
        lines.append(f"{low:>4} to {high:<4}{after:>4} {'#' * math.ceil(after * scale)}")
        lines.append(f"{'':12}{before:>4} {'.' * math.ceil(before * scale)}")
    return lines


def _counts(values: Sequence[float], bins: Sequence[int]) -> list[int]:
    """Counts per bin; the first and the last bin include what lies beyond them."""
    counts = [0] * (len(bins) - 1)
    for value in values:
        counts[max(0, sum(value >= edge for edge in bins[:-1]) - 1)] += 1
    return counts


def _draw_panel(image: Image.Image, left: int, size: tuple[int, int], panel: _Panel) -> None:
    """One histogram with bins of equal width, whatever they span, and counts above the bars."""
    draw, (width, height), margin = ImageDraw.Draw(image), size, 34
    bins, final = panel.bins, _counts(panel.values, panel.bins)
    initial = _counts(panel.initial, bins) if panel.initial else None
    step, top = (width - 2 * margin) / (len(bins) - 1), max(1, *final, *(initial or []))
    base, scale = height - margin, (height - 2.5 * margin) / top
    draw.text((left + margin, 10), panel.title, "black")
    for index, count in enumerate(final):
        x = left + margin + index * step
        bars = (
            ((initial[index], _INITIAL, 0.5, 0.9), (count, _FINAL, 0.1, 0.5))
            if initial
            else ((count, _FINAL, 0.1, 0.9),)
        )
        for amount, colour, start, end in bars:
            if amount:
                draw.rectangle((x + start * step, base - amount * scale, x + end * step, base), fill=colour)
                draw.text((x + start * step, base - amount * scale - 13), str(amount), "black")
        draw.text((x - 4, base + 6), str(bins[index]), "black")
    draw.text((left + width - margin - 8, base + 6), str(bins[-1]), "black")
    draw.line((left + margin, base, left + width - margin, base), "black")
