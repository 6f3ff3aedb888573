"""Draws what the benchmarks found. matplotlib comes with the extra ``bench``."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image, ImageDraw

from core.benchmarks import ablations
from core.benchmarks import fits as fitting
from core.benchmarks import model_sizes as sizes
from core.benchmarks import robustness as stability
from core.benchmarks.rendering import Measured, Point
from core.evaluation.protocol import Mean
from core.files import write_json
from core.rendering.progressive import RenderSettings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def write_rendering(found: Measured, folder: Path) -> None:
    """``render.json``, ``render.md`` and ``render.png``."""
    _write(folder, "render", found.told(), rendering_table(found), lambda: _rendering_chart(found))


def write_fitting(found: fitting.Measured, folder: Path) -> None:
    """``fit.json``, ``fit.md`` and ``fit.png``."""
    _write(folder, "fit", found.told(), fitting_table(found), lambda: _fitting_chart(found))


def write_stability(found: stability.Atlas, folder: Path) -> None:
    """``stability.json``, ``stability.md``, ``stability.png``, and ``failures.png`` with every failure of ours."""
    _write(folder, "stability", found.told(), stability_table(found), lambda: _stability_chart(found))
    ours = [trial for trial in found.trials if trial.seen and trial.preset == "normal"]
    _failures_sheet(ours).save(folder / "failures.png", optimize=True)


def write_ablations(found: ablations.AblationResults, folder: Path) -> None:
    """``ablations.json``, ``ablations.md`` and ``ablations.png``."""
    _write(folder, "ablations", found.to_dict(), ablations_table(found), lambda: _ablations_chart(found))


def write_sizes(found: sizes.Measured, folder: Path) -> None:
    """``size.json``, ``size.md`` and ``size.png``."""
    _write(folder, "size", found.told(), sizes_table(found), lambda: _sizes_chart(found))


def write_training(curves: dict[str, list[dict[str, float]]], path: Path) -> None:
    """``path`` as JSON and, where there is matplotlib, beside it as PNG: PSNR against minutes of training.

    Args:
        curves: by name, points with ``step``, ``seconds`` and ``psnr`` (dB).
    """
    write_json(path, curves)
    try:
        figure, (axes,) = _figure(1)
    except ValueError:
        return
    for name, points in curves.items():
        axes.plot([point["seconds"] / 60 for point in points], [point["psnr"] for point in points], "o-", label=name)
    axes.set(xlabel="minutes", ylabel="views not trained on (dB)")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path.with_suffix(".png"), dpi=110)


def prepare(folder: Path) -> None:
    """Sees to it, before hours are spent on measuring, that charts can be drawn and where they go.

    Raises ``ValueError`` where matplotlib is missing, ``OSError`` where there can be no such folder.
    """
    _figure(1)
    folder.mkdir(parents=True, exist_ok=True)


def _write(folder: Path, name: str, told: dict, table: str, chart: "Callable[[], Figure]") -> None:
    write_json(folder / f"{name}.json", told)
    (folder / f"{name}.md").write_text(table)
    chart().savefig(folder / f"{name}.png", dpi=110)


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
    head = "while dragging | size (px) | whole p50 (ms) | p95 | first picture p50 (ms) | p95 | its size (px) | rest (s)"
    lines += ["", f"| {head} |", "|" + "---|" * 8]
    for drag in found.drags:
        first = f"{drag.first_p50:.1f} | {drag.first_p95:.1f} | {drag.first_size} | {drag.rest:.2f}"
        lines.append(f"| {drag.what} | {drag.size} | {drag.p50:.1f} | {drag.p95:.1f} | {first} |")
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
    right.minorticks_off()
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


def fitting_table(found: fitting.Measured) -> str:
    """Markdown: a line for every preset, and how far confidence is to be trusted."""
    first = found.summaries[0]
    lines = [f"{found.machine}; {first.fits} views, cameras unknown; shares with their 95 % intervals.", ""]
    head = "preset | s (median) | start off by | rotation (median) | within 5° | within 10° | within 3 % | other views"
    lines += [f"| {head} | confidence (AUROC) |", "|" + "---|" * 9]
    for one in found.summaries:
        shares = map(_share, (one.within_5_degrees, one.within_10_degrees, one.within_3_percent))
        times = f"{one.preset} | {one.seconds:.1f} | {one.first_rotation:.0f}° | {one.rotation:.2f}°"
        trust = "" if one.separation is None else f"{one.separation:.2f}"
        lines.append(f"| {times} | {' | '.join(shares)} | {one.held_out.mean:.1f} dB | {trust} |")
    alike = [f"{trial.name} ({trial.preset}, {trial.rotation:.0f}°)" for trial in found.trials if trial.symmetric]
    if alike:
        lines += ["", f"Counted as right, for the object looks the same from there: {', '.join(alike)}."]
    if found.calibration:
        told = ", ".join(f"{name} {value:.3f}" for name, value in found.calibration._asdict().items())
        lines += ["", f"A calibration of the confidence on all these fits alone: {told}."]
    return "\n".join(lines) + "\n"


def _share(mean: Mean) -> str:
    return f"{100 * mean.mean:.0f} % ({100 * mean.low:.0f} to {100 * mean.high:.0f})"


def _fitting_chart(found: fitting.Measured) -> "Figure":
    figure, (left, right) = _figure(2)
    for one in found.summaries:
        # A curve goes on to the time at which half of the fits have ended, and ends with what they have found.
        end = one.seconds, one.rotation, one.within_5_degrees.mean
        curve = [point for point in one.curve if point[0] < one.seconds] + [end]
        left.plot([point[0] for point in curve], [max(point[1], 0.01) for point in curve], "o-", label=one.preset)
        right.plot([point[0] for point in curve], [100 * point[2] for point in curve], "o-", label=one.preset)
    left.set(xscale="log", yscale="log", xlabel="s", ylabel="rotation error (degrees, median)")
    right.set(xscale="log", ylim=(-2, 102), xlabel="s", ylabel="within 5 degrees (%)")
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend()
    figure.suptitle(f"{found.machine}, {found.summaries[0].fits} views", fontsize=9)
    return figure


def stability_table(found: stability.Atlas) -> str:
    """Markdown: the share of successes by stressor, level and preset, then every failure."""
    cells = found.cells()
    presets = list(next(iter(cells.values())))
    what = f"share of cameras within {stability.SUCCESS_DEGREES:g}°, nothing known of them"
    lines = [f"{found.machine}; {found.objects} objects of the model; {what}.", ""]
    lines += [f"| stressor | level | {' | '.join(presets)} |", "|" + "---|" * (2 + len(presets))]
    for (name, level), shares in cells.items():
        told = " | ".join(f"{100 * shares[preset]:.0f} %" for preset in presets)
        lines.append(f"| {name} | {level:g} {stability.STRESSORS[name].unit} | {told} |")
    alike = dict.fromkeys(trial.name for trial in found.trials if trial.ended == "symmetric")
    lines += ["", f"Found from another side, from which they look the same: {', '.join(alike) or 'none'}."]
    lines += ["", "| failure | level | preset | object | off by | confidence | ended |", "|" + "---|" * 7]
    for trial in found.trials:
        if not trial.success:
            off = "" if trial.rotation is None else f"{trial.rotation:.0f}°"
            trust = "" if trial.confidence is None else f"{trial.confidence:.2f}"
            which = f"{trial.stressor} | {trial.level:g} | {trial.preset} | {trial.name}"
            lines.append(f"| {which} | {off} | {trust} | {trial.ended} |")
    return "\n".join(lines) + "\n"


def _stability_chart(found: stability.Atlas) -> "Figure":
    cells = found.cells()
    names = list(dict.fromkeys(name for name, _ in cells))
    across = min(5, len(names))
    figure, panels = _figure(across, -(-len(names) // across), 2.6)
    for axes in panels[len(names) :]:
        axes.remove()
    for axes, name in zip(panels, names, strict=False):
        levels = [level for stressor, level in cells if stressor == name]
        for preset in next(iter(cells.values())):
            shares = [100 * cells[name, level][preset] for level in levels]
            axes.plot(range(len(levels)), shares, "o-", alpha=0.7, label=preset)
        axes.set_xticks(range(len(levels)), [f"{level:g}" for level in levels] if len(levels) > 1 else [""])
        axes.set(title=name, ylim=(-5, 105), xlabel=stability.STRESSORS[name].unit)
        axes.grid(alpha=0.3)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower right", ncols=len(labels))
    what = f"cameras within {stability.SUCCESS_DEGREES:g}°, or nothing believed where there is nothing (%)"
    figure.suptitle(f"{what}; {found.objects} objects; {found.machine}", fontsize=9)
    return figure


def ablations_table(found: ablations.AblationResults) -> str:
    """Markdown: the preset as it is, then without each component."""
    fits = found.ablations[0].summary.fits
    lines = [f"{found.machine}; {fits} views, cameras unknown; with 95 % intervals.", ""]
    head = "without | time | rotation (median) | within 5° | within 10° | other views (dB)"
    lines += [f"| {head} | against the first (dB) |", "|" + "---|" * 7]
    for ablation in found.ablations:
        one = ablation.summary
        shares = " | ".join(map(_share, (one.within_5_degrees, one.within_10_degrees)))
        times = f"{one.preset} | {ablation.time:.2f} | {one.rotation:.2f}°"
        lines.append(f"| {times} | {shares} | {one.held_out.mean:.1f} | {_gain(ablation.gain)} |")
    return "\n".join(lines) + "\n"


def _ablations_chart(found: ablations.AblationResults) -> "Figure":
    figure, (left, right) = _figure(2)
    whole, *others = found.ablations
    names, gains = [one.summary.preset for one in others], [one.gain for one in others]
    left.barh(names, [one.time for one in others])
    left.axvline(1.0, color="black", linewidth=0.8)
    left.set(xlabel="time (of the whole preset's)")
    around = [[one.mean - one.low for one in gains], [one.high - one.mean for one in gains]]
    right.errorbar([one.mean for one in gains], names, xerr=around, fmt="o", capsize=2)
    right.axvline(0.0, color="black", linewidth=0.8)
    left.invert_yaxis()
    right.set(xlabel="other views (dB over the whole preset's)", yticks=[], ylim=left.get_ylim())
    figure.suptitle(f"{found.machine}, {whole.summary.fits} views", fontsize=9)
    return figure


def _failures_sheet(failures: Sequence[stability.Trial]) -> Image.Image:
    """Every failure: the picture, what was found in it, and what they are called."""
    across, side, line = 4, 96, 13
    width, height = 2 * side + 12, side + 2 * line + 6
    sheet = Image.new("RGB", (across * width, max(1, -(-len(failures) // across)) * height), "white")
    draw = ImageDraw.Draw(sheet)
    for number, trial in enumerate(failures):
        left, top = number % across * width + 4, number // across * height + 2
        for index, pixels in enumerate(trial.seen or ()):
            if pixels is not None:
                sheet.paste(Image.fromarray(pixels).resize((side, side)), (left + index * (side + 2), top))
        draw.rectangle((left - 1, top - 1, left + 2 * side + 2, top + side), outline="lightgrey")
        draw.text((left, top + side + 2), f"{trial.stressor} {trial.level:g}", "black")
        trust = "" if trial.confidence is None else f", confidence {trial.confidence:.2f}"
        draw.text((left, top + side + 2 + line), f"{trial.ended}"[:18] + trust, "dimgrey")
    return sheet


def sizes_table(found: sizes.Measured) -> str:
    """Markdown: a line for every model."""
    what = f"{found.objects} objects, {found.steps} steps each"
    lines = [f"{found.machine}; {what}; held out: {found.tests} objects fitted on one view of known camera.", ""]
    head = "differs in | parameters | file (kB) | own, new views (dB) | held out (dB) | against the first (dB)"
    lines += [f"| {head} | cameras within 10° | 100,000 samples (ms) | blind fit (s) |", "|" + "---|" * 9]
    for one in found.sizes:
        name = f"{one.axis} {one.value}" if one.value else one.axis
        quality = f"{one.own:.2f} | {one.held_out.mean:.2f} | {_gain(one.gain)}"
        costs = f"{_share(one.found)} | {one.field_ms:.0f} | {one.fit_seconds:.1f}"
        lines.append(f"| {name} | {one.parameters} | {one.bytes / 1000:.0f} | {quality} | {costs} |")
    return "\n".join(lines) + "\n"


def _sizes_chart(found: sizes.Measured) -> "Figure":
    figure, (left, right) = _figure(2)
    centre = found.sizes[0]
    for axis in dict.fromkeys(one.axis for one in found.sizes if one.value):
        some = sorted((centre, *(one for one in found.sizes if one.axis == axis)), key=lambda one: one.bytes)
        marks = [one.parameters / 1000 for one in some]
        for axes, quality in ((left, [one.own for one in some]), (right, [one.held_out.mean for one in some])):
            (line,) = axes.plot([one.field_ms for one in some], quality, "-", alpha=0.6, label=axis)
            axes.scatter([one.field_ms for one in some], quality, marks, color=line.get_color())
    for one in found.sizes:
        if one.axis == "ours":
            left.plot(one.field_ms, one.own, "k*", markersize=14, label=one.axis, zorder=3)
            right.plot(one.field_ms, one.held_out.mean, "k*", markersize=14, label=one.axis, zorder=3)
    left.set(xlabel="ms for 100,000 samples", ylabel="own objects, new views (dB)")
    right.set(xlabel="ms for 100,000 samples", ylabel="held-out objects, one view (dB)")
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
    figure.suptitle(f"{found.machine}, {found.objects} objects, {found.steps} steps each; area: parameters", fontsize=9)
    return figure


def _gain(gain: Mean) -> str:
    return f"{gain.mean:+.2f} ({gain.low:+.2f} to {gain.high:+.2f})"


def _figure(columns: int, rows: int = 1, width: float = 5.2) -> tuple["Figure", Sequence["Axes"]]:
    """A figure and its axes, row after row; ``width`` of each in inches."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise ValueError("charts need matplotlib: pip install -e '.[bench]'") from None
    figure = Figure(figsize=(width * columns, 0.8 * width * rows), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())
