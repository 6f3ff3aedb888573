"""Markdown tables of the benchmarks: lists of columns, and the lines around them."""

import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import attrgetter, itemgetter
from typing import Any

from core.fitting.confidence import auroc
from core.lab.benchmarks.ablations import Ablation
from core.lab.benchmarks.candidates import SHIPPED, Judgement
from core.lab.benchmarks.csv_files import Results
from core.lab.benchmarks.fits import FitTrial, calibrate_fits, summarise_presets
from core.lab.benchmarks.photos import PhotoTrial
from core.lab.benchmarks.robustness import (
    ROUGH_DEGREES,
    SUCCESS_DEGREES,
    Rates,
    RobustnessTrial,
    rough_rates,
    success_rates,
)
from core.lab.benchmarks.stressors import STRESSORS
from core.lab.evaluation.protocol import ViewScore
from core.lab.evaluation.statistics import Mean, format_difference, format_fraction, mean_of

_SURE = 0.9  # a wrong camera of more confidence misleads
_THRESHOLDS = (0.0, 0.5, 0.8, _SURE)  # confidences from which a camera may be believed

Column = tuple[str, str | Callable[[Any], Any], str | Callable[[Any], str]]
"""heading; attribute or function of a row; format of its value"""


def markdown_table(columns: Sequence[Column], rows: Iterable[Any]) -> str:
    """Format a Markdown table.

    Example:
        >>> print(markdown_table([("ms", "real", "{:.1f}"), ("twice", lambda ms: 2 * ms, "{:.0f}")], [1.25]))
        | ms | twice |
        |---|---|
        | 1.2 | 2 |
    """
    lines = [[heading for heading, *_ in columns], *([_cell(row, *column[1:]) for column in columns] for row in rows)]
    head, *body = ("| " + " | ".join(line) + " |" for line in lines)
    return "\n".join((head, "|" + "---|" * len(columns), *body))


def _cell(row: Any, key: str | Callable[[Any], Any], form: str | Callable[[Any], str]) -> str:
    value = attrgetter(key)(row) if isinstance(key, str) else key(row)
    return form.format(value) if isinstance(form, str) else form(value)


def _text(heading: str, *blocks: str) -> str:
    """Join tables and sentences below a heading line, with empty lines between them."""
    return "\n\n".join((heading, *blocks)) + "\n"


# Fits


def fit_table(results: Results[FitTrial]) -> str:
    """Format a line per preset, then cameras that are right by symmetry, then a calibration of the confidence."""
    summaries = summarise_presets(results.rows)
    calibration = calibrate_fits(results.rows)
    symmetric = [f"{trial.name} ({trial.preset}, {trial.rotation:.0f}°)" for trial in results.rows if trial.symmetric]
    lines = []
    if symmetric:
        lines.append(f"Right by symmetry, for the object looks the same from there: {', '.join(symmetric)}.")
    if calibration:
        numbers = ", ".join(f"{name} {value:.3f}" for name, value in calibration._asdict().items())
        lines.append(f"A calibration of the confidence on these fits alone: {numbers}.")
    conditions = f"{summaries[0].fits} views, cameras unknown; shares with their 95 % intervals."
    return _text(f"{results.common['machine']}; {conditions}", markdown_table(_FITS, summaries), *lines)


def _view_score(score: ViewScore) -> str:
    return f"{score.psnr:.1f}, {score.overlap:.3f}, {score.haze:.3f}"


_FITS: list[Column] = [
    ("preset", "preset", "{}"),
    ("processor s (median)", "seconds", "{:.1f}"),
    ("initial rotation error", "initial_rotation", "{:.0f}°"),
    ("rotation error (median)", "rotation", "{:.2f}°"),
    ("within 5°", "within_5_degrees", format_fraction),
    ("within 10°", "within_10_degrees", format_fraction),
    ("within 3 %", "within_3_percent", format_fraction),
    ("other views", "held_out.mean", "{:.1f} dB"),
    ("at the dataset's size: dB, overlap, haze", "whole", lambda score: "" if score is None else _view_score(score)),
    ("confidence (AUROC)", "auroc", lambda area: "" if area is None else f"{area:.2f}"),
]


def ablations_table(results: Results[Ablation]) -> str:
    """Format a line per method."""
    heading = f"{results.common['machine']}; cameras unknown; 95 % intervals."
    return _text(heading, markdown_table(_ABLATIONS, results.rows))


_ABLATIONS: list[Column] = [
    ("normal preset", "summary.preset", "{}"),
    ("views", "summary.fits", "{}"),
    ("time", "time", "{:.2f}"),
    ("rotation error (median)", "summary.rotation", "{:.2f}°"),
    ("within 5°", "summary.within_5_degrees", format_fraction),
    ("within 10°", "summary.within_10_degrees", format_fraction),
    ("other views (dB)", "summary.held_out.mean", "{:.1f}"),
    ("difference to the full method (dB)", "gain", format_difference),
]


def candidates_table(results: Results[Judgement]) -> str:
    """Format a line per candidate and kind of camera, compared with the shipped model on the same views."""
    groups: dict[tuple[str, bool], dict[tuple[str, int], Judgement]] = {}
    for row in results.rows:
        groups.setdefault((row.candidate, row.posed), {})[row.name, row.view] = row
    columns: list[Column] = [
        ("candidate", itemgetter(0), "{}"),
        ("camera", lambda key: "known" if key[1] else "unknown", "{}"),
        ("fits", lambda key: len(groups[key]), "{}"),
        ("within 10°", lambda key: sum(row.rotation <= 10 for row in groups[key].values()), "{}"),
        ("the photo: dB, overlap, haze", lambda key: _mean_view(groups[key].values(), "photo"), _view_score),
        ("other views", lambda key: _mean_view(groups[key].values(), "novel"), _view_score),
        ("dB over the shipped model", lambda key: _gain_over(groups.get((SHIPPED, key[1])), groups[key], "psnr"), "{}"),
        ("overlap over it", lambda key: _gain_over(groups.get((SHIPPED, key[1])), groups[key], "overlap"), "{}"),
        ("s (median)", lambda key: statistics.median(row.seconds for row in groups[key].values()), "{:.1f}"),
    ]
    heading = "{machine}; {objects} objects; other views at the dataset's size, with 95 % intervals over views."
    return _text(heading.format(**results.common), markdown_table(columns, groups))


def _mean_view(rows: Iterable[Judgement], kind: str) -> ViewScore:
    scores = [getattr(row, kind) for row in rows]
    return ViewScore(*(statistics.mean(values) for values in zip(*scores, strict=True)))


def _gain_over(
    shipped: Mapping[tuple[str, int], Judgement] | None, own: Mapping[tuple[str, int], Judgement], measure: str
) -> str:
    """Format the mean gain in the other views of the fits that both have; nothing without any."""
    pairs = [(row.novel, shipped[key].novel) for key, row in own.items() if shipped and key in shipped]
    if not pairs or shipped is own:
        return ""
    return format_difference(mean_of([getattr(after, measure) - getattr(before, measure) for after, before in pairs]))


def robustness_table(results: Results[RobustnessTrial]) -> str:
    """Format success rates by stressor, level and preset; confidence and size errors; kinds of failures."""
    within = success_rates(results.rows)
    rough = rough_rates(results.rows)
    presets = list(dict.fromkeys(trial.preset for trial in results.rows))
    ours = [trial for trial in results.rows if trial.preset == presets[0]]
    groups = {key: [trial for trial in ours if (trial.stressor, trial.level) == key] for key in within}
    columns: list[Column] = [("stressor", itemgetter(0), "{}"), ("level", _level, "{}")]
    for preset in presets:
        columns.append((preset, _rate_of(preset, within), _rate_with_interval))
        columns.append((f"within {ROUGH_DEGREES:g}°", _rate_of(preset, rough), _rate))
    columns += [
        (f"wrong at confidence > {_SURE:g}", lambda key: sum(map(_misleads, groups[key])), "{}"),
        ("size error (median)", lambda key: _size_error(groups[key]), "{}"),
    ]
    rated = [trial for trial in ours if trial.confidence is not None]
    area = auroc([trial.confidence or 0 for trial in rated], [trial.success for trial in rated])
    failed = Counter(trial.outcome for trial in ours if not trial.success).most_common()
    symmetric = dict.fromkeys(trial.name for trial in results.rows if trial.outcome == "symmetric")
    measure = f"share of cameras within {SUCCESS_DEGREES:g}°, with 95 % intervals; and within {ROUGH_DEGREES:g}°."
    return _text(
        f"{results.common['machine']}; {len({trial.name for trial in results.rows})} objects; {measure}",
        markdown_table(columns, within),
        f"Confidence of {presets[0]} over {len(rated)} fits: AUROC {area:.3f}. Where there is an object to be found:",
        _risk_and_coverage([trial for trial in rated if trial.rotation is not None]),
        f"Failures of {presets[0]}: {', '.join(f'{count} {name}' for name, count in failed)}.",
        f"Right by symmetry, for they look the same from there: {', '.join(symmetric) or 'none'}.",
    )


def _risk_and_coverage(trials: Sequence[RobustnessTrial]) -> str:
    """Format by least confidence: the fraction of all fits, of wrong ones among them, and of all right fits."""

    def right(least: float) -> list[bool]:
        return [trial.success for trial in trials if (trial.confidence or 0) >= least]

    columns: list[Column] = [
        ("confidence from", lambda least: least, "{:g}"),
        ("fits (coverage)", lambda least: _ratio(len(right(least)), len(trials)), "{}"),
        ("wrong ones of these (risk)", lambda least: _ratio(right(least).count(False), len(right(least))), "{}"),
        ("of the right ones", lambda least: _ratio(sum(right(least)), sum(right(0.0))), "{}"),
    ]
    return markdown_table(columns, _THRESHOLDS)


def _ratio(count: int, total: int) -> str:
    return f"{100 * count / total:.0f} %" if total else ""


def _level(key: tuple[str, float]) -> str:
    name, level = key
    return f"{level:g} {STRESSORS[name].unit if name in STRESSORS else ''}".strip()


def _rate_of(preset: str, rates: Rates) -> Callable[[tuple[str, float]], Mean | None]:
    return lambda key: rates[key].get(preset)


def _rate_with_interval(rate: Mean | None) -> str:
    return format_fraction(rate) if rate else ""


def _rate(rate: Mean | None) -> str:
    return f"{100 * rate.mean:.0f} %" if rate else ""


def _misleads(trial: RobustnessTrial) -> bool:
    return not trial.success and (trial.confidence or 0) > _SURE


def _size_error(trials: Sequence[RobustnessTrial]) -> str:
    sizes = [abs(trial.size_error) for trial in trials if trial.size_error is not None]
    return f"{100 * statistics.median(sizes):.1f} %" if sizes else ""


# Photographs


def photos_table(results: Results[PhotoTrial]) -> str:
    """Format a line per photo, and one per category."""
    columns: list[Column] = [
        ("photo", "photo", "{}"),
        ("box", "detected", "{}"),
        ("cut out", "cut_out", "{}"),
        ("sure of it", "mask_confidence", "{:.2f}"),
        ("taken for", "taken_for", "{}"),
        ("side", "right_side", lambda right: "none" if right is None else "right" if right else "wrong"),
        ("confidence", "confidence", "{:.2f}"),
        ("PSNR", "psnr", "{:.1f}"),
        ("s", "seconds", "{:.1f}"),
    ]
    categories = sorted({trial.category for trial in results.rows})
    summaries = [_category_summary(category, results.rows) for category in categories]
    heading = "{preset} without a hint; sides and boxes by eye ({machine}).".format(**results.common)
    return _text(heading, *summaries, markdown_table(columns, results.rows))


def _category_summary(category: str, trials: Sequence[PhotoTrial]) -> str:
    trials = [trial for trial in trials if trial.category == category]
    counts = Counter(trial.cut_out for trial in trials)
    model = sum(trial.taken_for == category for trial in trials)
    side = sum(trial.right for trial in trials)
    wrong = [trial.confidence for trial in trials if not trial.right and trial.right_side is not None]
    cut = f"cut out whole {counts['whole']}, in part {counts['part']}, wrongly {counts['wrong']}"
    right = f"right model {model}, right side {side}; surest wrong camera {max(wrong, default=0.0):.2f}"
    return f"{len(trials)} {category}: {cut}; {right}."
