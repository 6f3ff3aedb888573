"""What the benchmarks measured as Markdown tables."""

from core.benchmarks.ablations import AblationResults
from core.benchmarks.fits import FitResults
from core.benchmarks.model_sizes import ModelSizeResults
from core.benchmarks.rendering import RenderingResults
from core.benchmarks.robustness import SUCCESS_DEGREES, RobustnessResults
from core.benchmarks.stressors import STRESSORS
from core.evaluation.statistics import format_difference, format_share


def rendering_table(found: RenderingResults) -> str:
    """Milliseconds and PSNR by recipe, of the ablations, by image size, and while something moves."""
    naive = found.naive[-1].ms
    lines = [f"{found.machine}; {found.views} views; PSNR against 256 exact samples in float32.", ""]
    lines += [
        f"| renderer | samples | ms | times naive {found.naive[-1].samples} | PSNR (dB) | worst view | worst pixel |"
    ]
    lines += ["|" + "---|" * 7]
    for one in (*found.naive, *found.fast):
        quality = f"{one.psnr:.1f} | {one.worst_view:.1f} | {one.worst_pixel:.3f}"
        lines.append(f"| {one.recipe} | {one.samples} | {one.ms:.1f} | {naive / one.ms:.0f} | {quality} |")
    full = found.ablation[0]
    lines += ["", "| ablation, default settings | ms | difference | PSNR (dB) | difference |", "|" + "---|" * 5]
    for one in found.ablation:
        change = f"{one.ms - full.ms:+.1f} ms | {one.psnr:.1f} | {one.psnr - full.psnr:+.1f} dB"
        lines.append(f"| {one.recipe} | {one.ms:.1f} | {change} |")
    lines += ["", "| size (px) | ms | PSNR (dB) |", "|" + "---|" * 3]
    lines += [f"| {one.size} | {one.ms:.1f} | {one.psnr:.1f} |" for one in found.sizes]
    head = (
        "moving | size (px) | full image p50 (ms) | p95 | preview p50 (ms) | p95 | preview size (px) | settle time (s)"
    )
    lines += ["", f"| {head} |", "|" + "---|" * 8]
    for move in found.interactions:
        preview = f"{move.preview_p50:.1f} | {move.preview_p95:.1f} | {move.preview_size} | {move.settle_time:.2f}"
        lines.append(f"| {move.what} | {move.size} | {move.p50:.1f} | {move.p95:.1f} | {preview} |")
    return "\n".join(lines) + "\n"


def fit_table(found: FitResults) -> str:
    """A line per preset, then cameras that are right by symmetry, then a calibration of the confidence."""
    summaries, calibration = found.summaries, found.calibration
    lines = [f"{found.machine}; {summaries[0].fits} views, cameras unknown; shares with their 95 % intervals.", ""]
    head = (
        "preset | s (median) | initial rotation error | rotation error (median) | within 5° | within 10° | within 3 %"
    )
    lines += [f"| {head} | other views | confidence (AUROC) |", "|" + "---|" * 9]
    for one in summaries:
        shares = map(format_share, (one.within_5_degrees, one.within_10_degrees, one.within_3_percent))
        errors = f"{one.preset} | {one.seconds:.1f} | {one.initial_rotation:.0f}° | {one.rotation:.2f}°"
        auroc = "" if one.auroc is None else f"{one.auroc:.2f}"
        lines.append(f"| {errors} | {' | '.join(shares)} | {one.held_out.mean:.1f} dB | {auroc} |")
    symmetric = [f"{trial.name} ({trial.preset}, {trial.rotation:.0f}°)" for trial in found.trials if trial.symmetric]
    if symmetric:
        lines += ["", f"Right by symmetry, for the object looks the same from there: {', '.join(symmetric)}."]
    if calibration:
        numbers = ", ".join(f"{name} {value:.3f}" for name, value in calibration._asdict().items())
        lines += ["", f"A calibration of the confidence on these fits alone: {numbers}."]
    return "\n".join(lines) + "\n"


def robustness_table(found: RobustnessResults) -> str:
    """The share of successes by stressor, level and preset, then every failure."""
    rates = found.success_rates()
    presets = list(next(iter(rates.values())))
    lines = [f"{found.machine}; {found.objects} training objects; share of cameras within {SUCCESS_DEGREES:g}°.", ""]
    lines += [f"| stressor | level | {' | '.join(presets)} |", "|" + "---|" * (2 + len(presets))]
    for (name, level), shares in rates.items():
        cells = " | ".join(f"{100 * shares[preset]:.0f} %" for preset in presets)
        unit = STRESSORS[name].unit if name in STRESSORS else ""
        lines.append(f"| {name} | {f'{level:g} {unit}'.strip()} | {cells} |")
    symmetric = dict.fromkeys(trial.name for trial in found.trials if trial.outcome == "symmetric")
    lines += ["", f"Right by symmetry, for they look the same from there: {', '.join(symmetric) or 'none'}."]
    lines += ["", "| failure | level | preset | object | rotation error | confidence | outcome |", "|" + "---|" * 7]
    for trial in found.trials:
        if not trial.success:
            rotation = "" if trial.rotation is None else f"{trial.rotation:.0f}°"
            confidence = "" if trial.confidence is None else f"{trial.confidence:.2f}"
            which = f"{trial.stressor} | {trial.level:g} | {trial.preset} | {trial.name}"
            lines.append(f"| {which} | {rotation} | {confidence} | {trial.outcome} |")
    return "\n".join(lines) + "\n"


def ablations_table(found: AblationResults) -> str:
    """The full method, then without each component."""
    fits = found.ablations[0].summary.fits
    lines = [f"{found.machine}; {fits} views, cameras unknown; with 95 % intervals.", ""]
    head = "normal preset | time | rotation error (median) | within 5° | within 10° | other views (dB)"
    lines += [f"| {head} | difference to the full method (dB) |", "|" + "---|" * 7]
    for part in found.ablations:
        one = part.summary
        shares = " | ".join(map(format_share, (one.within_5_degrees, one.within_10_degrees)))
        times = f"{one.preset} | {part.time:.2f} | {one.rotation:.2f}°"
        lines.append(f"| {times} | {shares} | {one.held_out.mean:.1f} | {format_difference(part.gain)} |")
    return "\n".join(lines) + "\n"


def model_sizes_table(found: ModelSizeResults) -> str:
    """A line per model."""
    what = f"{found.objects} objects, {found.steps} steps each"
    lines = [f"{found.machine}; {what}; held out: {found.tests} objects fitted on one view of known camera.", ""]
    head = "differs in | parameters | file (kB) | training objects, new views (dB) | held out (dB)"
    costs = "cameras within 10° | 100,000 samples (ms) | blind fit (s)"
    lines += [f"| {head} | difference to the baseline (dB) | {costs} |", "|" + "---|" * 9]
    for one in found.sizes:
        name = f"{one.axis.replace('_', ' ')} {one.value}" if one.value else one.axis
        quality = f"{one.new_views:.2f} | {one.held_out.mean:.2f} | {format_difference(one.gain)}"
        speed = f"{format_share(one.found)} | {one.field_ms:.0f} | {one.fit_seconds:.1f}"
        lines.append(f"| {name} | {one.parameters} | {one.bytes / 1000:.0f} | {quality} | {speed} |")
    return "\n".join(lines) + "\n"
