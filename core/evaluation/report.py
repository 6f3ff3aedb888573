"""What an evaluation says: a table and a histogram in text, the numbers as JSON, a chart as PNG."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

from PIL import Image, ImageDraw

from core.evaluation.disentanglement import CellScore, swap_summary
from core.evaluation.protocol import Mean, ObjectScore, PoseSummary, Protocol, Summary, summarised
from core.files import write_json

_ROTATION_BINS = (0, 1, 2, 3, 5, 10, 20, 45, 90, 135, 180)
"""degrees"""
_TRANSLATION_BINS = (0, 1, 2, 3, 5, 10, 20, 50, 100, 200)
"""per cent of the distance"""
_PSNR_BINS = tuple(range(10, 42, 2))
"""dB"""
_SHEET = 24
"""cells on the sheet of a swap, at the most"""
_FOUND, _FIRST = "#2f6fb0", "#8cc084"


class _Panel(NamedTuple):
    """A histogram."""

    title: str
    bins: Sequence[int]
    values: Sequence[float]
    first: Sequence[float] = ()
    """the same at the start of the fit"""


def told(scores: Sequence[ObjectScore], protocol: Protocol) -> str:
    """The paper's table for these scores, and where cameras were estimated their errors and a histogram of them."""
    summary = summarised(scores)
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
    """The numbers as JSON, per object too, and a chart as PNG beside it."""
    objects = [asdict(score) | {"outlier": score.outlier} for score in scores]
    content = about | {"protocol": asdict(protocol), "summary": asdict(summarised(scores)), "objects": objects}
    write_json(path, content)
    chart(scores).save(path.with_suffix(".png"))


def chart(scores: Sequence[ObjectScore]) -> Image.Image:
    """Histograms: PSNR of objects and, where cameras were estimated, their errors with those at the start."""
    panels = [_Panel("PSNR (dB), objects", _PSNR_BINS, [score.psnr for score in scores])]
    poses = [pose for score in scores for pose in score.poses]
    if poses:
        rotation = [pose.rotation for pose in poses], [pose.first_rotation for pose in poses]
        translation = [100 * pose.translation for pose in poses], [100 * pose.first_translation for pose in poses]
        panels.append(_Panel("rotation error (degrees); green: at the start", _ROTATION_BINS, *rotation))
        panels.append(_Panel("translation error (%); green: at the start", _TRANSLATION_BINS, *translation))
    width, height = 460, 300
    image = Image.new("RGB", (width * len(panels), height), "white")
    for index, panel in enumerate(panels):
        _draw_panel(image, index * width, (width, height), panel)
    return image


def swap_told(scores: Sequence[CellScore]) -> str:
    """Held-out cells beside trained ones, what a texture edit changes, and what codes give away."""
    found = swap_summary(scores)
    rows = (
        ("held-out cells, codes of two objects", found.swapped, found.swapped_ssim, found.swapped_cells),
        ("the same, fitted to other views", found.direct, found.direct_ssim, found.swapped_cells),
        ("trained cells, their own codes", found.trained, found.trained_ssim, found.trained_cells),
    )
    lines = [f"{'':38}{'PSNR (dB)':>22}{'SSIM':>24}{'cells':>9}"]
    lines += [
        f"{name:38}{_interval(a, 2):>22}{_interval(b, 3):>24}{count:>9}"
        for name, a, b, count in rows
        if not math.isnan(a.mean)
    ]
    lines.append(f"\nanother texture changes the silhouette by at most {found.opacity_change:.2g} of full opacity")
    lines.append(f"and the ground by at most {found.ground_change:.2g} of full colour")
    if found.probes:
        lines.append(f"\n{'read from fitted codes':38}{'right (%)':>22}{'chance (%)':>24}{'cells':>9}")
    for name, probe in found.probes.items():
        cells = (_interval(probe.accuracy, 0, 100), f"{100 * probe.chance:.1f}", probe.cells) if probe else ("-",) * 3
        lines.append(f"{name:38}{cells[0]:>22}{cells[1]:>24}{cells[2]:>9}")
    return "\n".join(lines)


def write_swap_report(path: Path, scores: Sequence[CellScore], about: dict[str, str]) -> None:
    """The numbers as JSON, per cell too, and beside it, as PNG, true and drawn views of the cells, held-out first."""
    cells = [
        {
            "name": score.cell.place.name,
            "trained": score.cell.trained,
            "psnr": score.psnr,
            "ssim": score.ssim,
            "direct": score.direct,
        }
        for score in scores
    ]
    write_json(path, about | {"summary": asdict(swap_summary(scores)), "cells": cells})
    first = sorted(scores, key=lambda score: score.cell.trained)[:_SHEET]
    height, width = first[0].pictures.shape[:2]
    sheet = Image.new("RGB", (width * min(4, len(first)), height * math.ceil(len(first) / 4)), "white")
    for index, score in enumerate(first):
        sheet.paste(Image.fromarray(score.pictures), (index % 4 * width, index // 4 * height))
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
    lines = [f"{head:22}{'at the start':>24}{'found':>24}{'- outliers':>24}"]
    rows = (("rotation (degrees)", "rotation", 1.0), ("translation (%)", "translation", 100.0))
    for name, field, scale in rows:
        found = [getattr(pose, f"first_{field}"), getattr(pose, field), getattr(without, field) if without else None]
        cells = (_interval(value, 2, scale) if value else "-" for value in found)
        lines.append(f"{name:22}" + "".join(f"{cell:>24}" for cell in cells))
    shares = (("5 degrees", "within_5_degrees"), ("10 degrees", "within_10_degrees"))
    for limit, field in (*shares, ("3 %", "within_3_percent"), ("5 %", "within_5_percent")):
        lines.append(f"{f'within {limit} (%)':22}{'':24}{_interval(getattr(pose, field), 0, 100):>24}")
    return lines


def _pose_histogram(scores: Sequence[ObjectScore]) -> list[str]:
    poses = [pose for score in scores for pose in score.poses]
    found = _counts([pose.rotation for pose in poses], _ROTATION_BINS)
    first = _counts([pose.first_rotation for pose in poses], _ROTATION_BINS)
    scale = min(1.0, 50 / max(found + first))
    lines = ["rotation error (degrees): # found, . at the start"]
    for low, high, ends, begins in zip(_ROTATION_BINS, _ROTATION_BINS[1:], found, first, strict=False):
        lines.append(f"{low:>4} to {high:<4}{ends:>4} {'#' * math.ceil(ends * scale)}")
        lines.append(f"{'':12}{begins:>4} {'.' * math.ceil(begins * scale)}")
    return lines


def _counts(values: Sequence[float], bins: Sequence[int]) -> list[int]:
    """How many lie in every bin; the first and the last take in what lies beyond them."""
    counts = [0] * (len(bins) - 1)
    for value in values:
        counts[max(0, sum(value >= edge for edge in bins[:-1]) - 1)] += 1
    return counts


def _draw_panel(image: Image.Image, left: int, size: tuple[int, int], panel: _Panel) -> None:
    """One histogram with bins of equal width, whatever they span, and counts above the bars."""
    draw, (width, height), margin = ImageDraw.Draw(image), size, 34
    bins, found = panel.bins, _counts(panel.values, panel.bins)
    begun = _counts(panel.first, bins) if panel.first else None
    step, top = (width - 2 * margin) / (len(bins) - 1), max(1, *found, *(begun or []))
    base, scale = height - margin, (height - 2.5 * margin) / top
    draw.text((left + margin, 10), panel.title, "black")
    for index, count in enumerate(found):
        x = left + margin + index * step
        bars = ((begun[index], _FIRST, 0.5, 0.9), (count, _FOUND, 0.1, 0.5)) if begun else ((count, _FOUND, 0.1, 0.9),)
        for amount, colour, start, end in bars:
            if amount:
                draw.rectangle((x + start * step, base - amount * scale, x + end * step, base), fill=colour)
                draw.text((x + start * step, base - amount * scale - 13), str(amount), "black")
        draw.text((x - 4, base + 6), str(bins[index]), "black")
    draw.text((left + width - margin - 8, base + 6), str(bins[-1]), "black")
    draw.line((left + margin, base, left + width - margin, base), "black")
