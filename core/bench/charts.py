"""Draws what the benchmarks found. matplotlib comes with the extra ``bench``."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from core.bench.rendering import Measured, Point
from core.frames import RenderSettings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def write_rendering(found: Measured, folder: Path) -> None:
    """``render.json``, ``render.md`` and ``render.png``."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "render.json").write_text(json.dumps(found.told(), indent=1) + "\n")
    (folder / "render.md").write_text(rendering_table(found))
    _rendering_chart(found).savefig(folder / "render.png", dpi=110)


def rendering_table(found: Measured) -> str:
    """Markdown: the curve with its factors over the naive 96 samples, what each part earns, and drags."""
    naive = found.naive[-1].ms
    lines = [f"{found.machine}; {found.views} views; PSNR against 256 exact samples in float32.", ""]
    lines += ["| recipe | samples | ms | times naive 96 | PSNR (dB) | worst view | worst pixel |", "|" + "---|" * 7]
    for point in (*found.naive, *found.fast):
        quality = f"{point.psnr:.1f} | {point.worst_view:.1f} | {point.worst_pixel:.3f}"
        lines.append(f"| {point.recipe} | {point.samples} | {point.ms:.1f} | {naive / point.ms:.0f} | {quality} |")
    whole = found.ablation[0]
    lines += ["", "| default settings | ms | costs | PSNR (dB) | gives |", "|" + "---|" * 5]
    for point in found.ablation:
        change = f"{point.ms - whole.ms:+.1f} ms | {point.psnr:.1f} | {point.psnr - whole.psnr:+.1f} dB"
        lines.append(f"| {point.recipe} | {point.ms:.1f} | {change} |")
    lines += ["", "| size (px) | ms | PSNR (dB) |", "|" + "---|" * 3]
    lines += [f"| {point.size} | {point.ms:.1f} | {point.psnr:.1f} |" for point in found.sizes]
    lines += ["", "| while dragging | size (px) | p50 (ms) | p95 (ms) |", "|" + "---|" * 4]
    lines += [f"| {drag.what} | {drag.size} | {drag.p50:.1f} | {drag.p95:.1f} |" for drag in found.drags]
    return "\n".join(lines) + "\n"


def _rendering_chart(found: Measured) -> "Figure":
    figure, (left, right) = _figure(2)
    for name, points in (("naive, float32", found.naive), ("this renderer", found.fast)):
        _curve(left, name, points)
    chosen = [point for point in found.fast if point.samples == RenderSettings().samples]
    left.plot([p.ms for p in chosen], [p.psnr for p in chosen], "k*", markersize=14, label="final picture", zorder=3)
    left.set(xscale="log", xlabel="ms per 128 x 128 frame", ylabel="PSNR (dB) to the exact picture")
    right.plot([p.size for p in found.sizes], [p.ms for p in found.sizes], "o-", label="ms per frame")
    first = found.sizes[0]
    even = [first.ms * (p.size / first.size) ** 2 for p in found.sizes]
    right.plot([p.size for p in found.sizes], even, ":", color="grey", label="as the picture's pixels")
    right.set(xscale="log", yscale="log", xlabel="width and height (px)", ylabel="ms per frame")
    right.set_xticks([p.size for p in found.sizes], [str(p.size) for p in found.sizes])
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend()
    figure.suptitle(f"{found.machine}, {found.views} views", fontsize=9)
    return figure


def _curve(axes: "Axes", name: str, points: Sequence[Point]) -> None:
    (line,) = axes.plot([point.ms for point in points], [point.psnr for point in points], "o-", label=name)
    for point in points:
        spot = point.ms, point.psnr
        axes.annotate(
            str(point.samples), spot, (4, -10), textcoords="offset points", fontsize=7, color=line.get_color()
        )


def _figure(columns: int) -> tuple["Figure", Sequence["Axes"]]:
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise ValueError("charts need matplotlib: pip install -e '.[bench]'") from None
    figure = Figure(figsize=(5.2 * columns, 4.2), layout="constrained")
    return figure, figure.subplots(1, columns)
