"""What the benchmarks measured as Markdown tables."""

import statistics
from collections import Counter
from collections.abc import Sequence

from core.benchmarks.ablations import AblationResults
from core.benchmarks.architectures import Architecture
from core.benchmarks.fits import FitResults
from core.benchmarks.model_sizes import ModelSizeResults
from core.benchmarks.recipe import RecipeScore
from core.benchmarks.rendering import RenderingResults
from core.benchmarks.robustness import ROUGH_DEGREES, SUCCESS_DEGREES, RobustnessResults
from core.benchmarks.scaling import ScalingResults
from core.benchmarks.stressors import STRESSORS
from core.evaluation.statistics import format_difference, format_share
from core.fitting.confidence import auroc

_SURE = 0.9
"""A wrong camera of more confidence misleads."""


def rendering_table(found: RenderingResults) -> str:
    """Milliseconds and PSNR by recipe, of the ablations, by image size, and while something moves."""
    naive = found.naive[-1].ms
    lines = [f"{found.machine}; {found.views} views; PSNR against 256 exact samples in float32.", ""]
    lines += [
        f"| renderer | samples | ms | times naive {found.naive[-1].samples} | PSNR (dB) | worst view | worst pixel |"
    ]
    lines += ["|" + "---|" * 7]
    for one in (*found.naive, *found.fast, *found.float32, *found.baked):
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
    """The share of successes by stressor, level and preset; how confidence and size fare; how often which way fails."""
    within, rough = found.success_rates(), found.rough_rates()
    presets = list(dict.fromkeys(trial.preset for trial in found.trials))
    what = f"{found.objects} objects; share of cameras within {SUCCESS_DEGREES:g}°, with 95 % intervals"
    lines = [f"{found.machine}; {what}; and within {ROUGH_DEGREES:g}°.", ""]
    heads = " | ".join(f"{preset} | within {ROUGH_DEGREES:g}°" for preset in presets)
    lines += [f"| stressor | level | {heads} | wrong at confidence > 0.9 | size error (median) |"]
    lines += ["|" + "---|" * (4 + 2 * len(presets))]
    for name, level in within:
        unit = STRESSORS[name].unit if name in STRESSORS else ""
        shares = (
            f"{format_share(within[name, level][one])} | {100 * rough[name, level][one].mean:.0f} %"
            if one in within[name, level]
            else " | "
            for one in presets
        )
        trials = [one for one in found.trials if (one.stressor, one.level, one.preset) == (name, level, presets[0])]
        sure = sum(not one.success and (one.confidence or 0) > _SURE for one in trials)
        sizes = [abs(one.size_error) for one in trials if one.size_error is not None]
        size = f"{100 * statistics.median(sizes):.1f} %" if sizes else ""
        lines.append(f"| {name} | {f'{level:g} {unit}'.strip()} | {' | '.join(shares)} | {sure} | {size} |")
    judged = [one for one in found.trials if one.preset == presets[0] and one.confidence is not None]
    area = auroc([one.confidence or 0 for one in judged], [one.success for one in judged])
    lines += ["", f"Confidence of {presets[0]} over {len(judged)} fits: AUROC {area:.3f}."]
    failed = Counter(one.outcome for one in found.trials if not one.success and one.preset == presets[0])
    lines += ["", f"Failures of {presets[0]}: {', '.join(f'{n} {name}' for name, n in failed.most_common())}."]
    symmetric = dict.fromkeys(trial.name for trial in found.trials if trial.outcome == "symmetric")
    lines += ["", f"Right by symmetry, for they look the same from there: {', '.join(symmetric) or 'none'}."]
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


def scaling_table(found: ScalingResults) -> str:
    """A line per number of training shapes."""
    what = f"{found.category}, {found.steps} steps each; held out: {found.tests} objects, one view fitted"
    lines = [f"{found.machine}; {what}; with 95 % intervals.", ""]
    head = "shapes | objects | training objects, new views (dB) | held out, camera known (dB)"
    lines += [f"| {head} | difference to the fewest (dB) | cameras within 10° |", "|" + "---|" * 6]
    for one in found.points:
        quality = f"{one.new_views:.2f} | {one.held_out.mean:.2f} | {format_difference(one.gain)}"
        lines.append(f"| {one.shapes} | {one.objects} | {quality} | {format_share(one.found)} |")
    return "\n".join(lines) + "\n"


def architectures_table(about: str, found: Sequence[Architecture]) -> str:
    """A line per architecture."""
    lines = [f"{about}; with 95 % intervals.", ""]
    head = "architecture | parameters | training objects, new views (dB) | another texture changes the opacity by"
    lines += [f"| {head} |", "|" + "---|" * 4]
    for one in found:
        mean, low, high = one.opacity_change
        change = "0" if not high else f"{mean:.3f} ({low:.3f} to {high:.3f})"
        lines.append(f"| {one.name} | {one.parameters} | {one.new_views:.2f} | {change} |")
    return "\n".join(lines) + "\n"


def recipe_table(about: str, found: Sequence[RecipeScore]) -> str:
    """A line per variant of the recipe, the first of them the default."""
    lines = [f"{about}; held out: {len(found[0].held_out)} objects, one view of known camera; 95 % intervals.", ""]
    head = "recipe | steps | time (s) | training objects, new views (dB) | held out (dB)"
    lines += [f"| {head} | difference to the default (dB) |", "|" + "---|" * 6]
    for one in found:
        quality = f"{one.new_views:.2f} | {statistics.mean(one.held_out):.2f} | {format_difference(one.gain(found[0]))}"
        lines.append(f"| {one.name} | {one.steps} | {one.seconds:.0f} | {quality} |")
    return "\n".join(lines) + "\n"
