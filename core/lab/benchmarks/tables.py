"""Markdown tables of the benchmarks, and the lines around them, from the frames of their rows."""

from collections.abc import Iterable, Mapping
from typing import Any

import pandas as pd

from core.fitting.confidence import auroc
from core.lab.benchmarks.candidates import SHIPPED
from core.lab.benchmarks.fits import SURE_FROM, FitSummary, calibrate_fits, reliability, summarise_presets
from core.lab.benchmarks.robustness import ROUGH_DEGREES, SUCCESS_DEGREES, rough_rates, success_rates, successes
from core.lab.benchmarks.stressors import STRESSORS
from core.lab.evaluation.protocol import ViewScore
from core.lab.evaluation.statistics import Mean, format_difference, format_fraction, mean_of

_SURE = 0.9  # a wrong camera of more confidence misleads
_THRESHOLDS = (0.0, 0.5, 0.8, _SURE)  # confidences from which a camera may be believed


def markdown(rows: Iterable[Mapping[str, object]]) -> str:
    """Format rows of cells by heading as a Markdown table.

    Example:
        >>> print(markdown([{"ms": "1.2", "twice": 2}]))
        | ms | twice |
        |---|---|
        | 1.2 | 2 |
    """
    table = pd.DataFrame(list(rows)).astype(str)
    head, *body = ("| " + " | ".join(line) + " |" for line in ([*table.columns], *table.to_numpy()))
    return "\n".join((head, "|" + "---|" * table.shape[1], *body))


def _text(heading: str, *blocks: str) -> str:
    """Join tables and sentences below a heading line, with empty lines between them."""
    return "\n\n".join((heading, *blocks)) + "\n"


def interval(row: Any, name: str) -> Mean:
    """Return a mean with its interval from a row of a frame."""
    return Mean(*(row[f"{name}.{bound}"] for bound in Mean._fields))


# Fits


def fit_table(trials: pd.DataFrame) -> str:
    """Format a line per preset, then cameras that are right by symmetry, then a calibration of the confidence."""
    symmetric = [f"{row.name} ({row.preset}, {row.rotation:.0f}°)" for row in trials[trials.symmetric].itertuples()]
    lines = []
    if symmetric:
        lines.append(f"Right by symmetry, for the object looks the same from there: {', '.join(symmetric)}.")
    if calibration := calibrate_fits(trials):
        numbers = ", ".join(f"{name} {value:.3f}" for name, value in calibration._asdict().items())
        lines.append(f"A calibration of the confidence on these fits alone: {numbers}.")
        bands = (
            f"{row.stated:.2f} stated, {row.observed:.2f} observed ({row.fits:.0f})"
            for row in reliability(trials).itertuples()
        )
        lines.append(f"Confidence by bands, fits in brackets: {'; '.join(bands)}.")
    summaries = summarise_presets(trials)
    conditions = f"{summaries[0].fits} views, cameras unknown; shares with their 95 % intervals."
    table = markdown(map(_fit_cells, summaries))
    return _text(f"{trials.machine[0]}; {conditions}", table, *lines)


def _fit_cells(summary: FitSummary) -> dict[str, str]:
    return {
        "preset": summary.preset,
        "processor s (median)": f"{summary.seconds:.1f}",
        "initial rotation error": f"{summary.initial_rotation:.0f}°",
        "rotation error (median)": f"{summary.rotation:.2f}°",
        "within 5°": format_fraction(summary.within_5_degrees),
        "within 10°": format_fraction(summary.within_10_degrees),
        "within 3 %": format_fraction(summary.within_3_percent),
        "other views": f"{summary.held_out.mean:.1f} dB",
        "at the dataset's size: dB, overlap, haze": _view_score(summary.whole) if summary.whole else "",
        "confidence (AUROC)": "" if summary.auroc is None else f"{summary.auroc:.2f}",
    }


def _view_score(score: ViewScore) -> str:
    return f"{score.psnr:.1f}, {score.overlap:.3f}, {score.haze:.3f}"


def ablations_table(ablations: pd.DataFrame) -> str:
    """Format a line per method."""
    rows = (
        {
            "normal preset": row["summary.preset"],
            "views": row["summary.fits"],
            "time": f"{row['time']:.2f}",
            "within 10°": format_fraction(interval(row, "summary.within_10_degrees")),
            "other views (dB)": f"{row['summary.held_out.mean']:.1f}",
            "difference to the full method (dB)": format_difference(interval(row, "gain")),
            "photo (dB)": f"{row['summary.photo']:.1f}",
            "restarts": f"{row['summary.restarts']:.0%}",
            f"wrong above {SURE_FROM:g}": row["summary.wrong_sure"],
            "confidence (AUROC)": f"{row['summary.auroc']:.2f}" if pd.notna(row.get("summary.auroc")) else "",
        }
        for row in ablations.to_dict("records")
    )
    return _text(f"{ablations.machine[0]}; cameras unknown; 95 % intervals.", markdown(rows))


def candidates_table(judgements: pd.DataFrame) -> str:
    """Format a line per candidate and kind of camera, compared with the shipped model on the same views."""
    rows = []
    for (name, posed), own in judgements.groupby(["candidate", "posed"], sort=False):
        shipped = judgements[(judgements.candidate == SHIPPED) & (judgements.posed == posed)]
        photo, novel = (ViewScore(*own.filter(like=f"{kind}.").mean()) for kind in ("photo", "novel"))
        both = own.merge(shipped, on=["name", "view"], suffixes=("", " shipped")) if name != SHIPPED else own[:0]
        gains = (
            format_difference(mean_of(both[measure] - both[f"{measure} shipped"])) if len(both) else ""
            for measure in ("novel.psnr", "novel.overlap")
        )
        cells = (
            *(name, "known" if posed else "unknown", len(own), (own.rotation <= 10).sum()),
            *(_view_score(photo), _view_score(novel), *gains, f"{own.seconds.median():.1f}"),
        )
        rows.append(dict(zip(_CANDIDATES, cells, strict=True)))
    first = judgements.iloc[0]
    heading = f"{first.machine}; {first.objects} objects; other views at the dataset's size, with 95 % intervals over"
    return _text(f"{heading} views.", markdown(rows))


_CANDIDATES = (
    *("candidate", "camera", "fits", "within 10°", "the photo: dB, overlap, haze", "other views"),
    *("dB over the shipped model", "overlap over it", "s (median)"),
)


def robustness_table(trials: pd.DataFrame) -> str:
    """Format success rates by stressor, level and preset; confidence and size errors; kinds of failures."""
    first = trials.preset[0]
    ours = trials[trials.preset == first]
    failed = ours.outcome[~successes(ours)].value_counts()
    rated = ours[ours.confidence.notna()]
    area = auroc(rated.confidence.tolist(), successes(rated).tolist())
    symmetric = trials.name[trials.outcome == "symmetric"].unique()
    measure = f"share of cameras within {SUCCESS_DEGREES:g}°, with 95 % intervals; and within {ROUGH_DEGREES:g}°."
    return _text(
        f"{trials.machine[0]}; {trials.name.nunique()} objects; {measure}",
        markdown(_stressor_rows(trials, ours)),
        f"Confidence of {first} over {len(rated)} fits: AUROC {area:.3f}. Where there is an object to be found:",
        markdown(_risk_and_coverage(rated[rated.rotation.notna()])),
        f"Failures of {first}: {', '.join(f'{count} {name}' for name, count in failed.items())}.",
        f"Right by symmetry, for they look the same from there: {', '.join(symmetric) or 'none'}.",
    )


def _stressor_rows(trials: pd.DataFrame, ours: pd.DataFrame) -> Iterable[dict[str, object]]:
    within = success_rates(trials)
    rough = rough_rates(trials)
    misleading = ~successes(ours) & (ours.confidence > _SURE)
    for (stressor, level), _ in trials.groupby(["stressor", "level"], sort=False):
        unit = STRESSORS[stressor].unit if stressor in STRESSORS else ""
        row: dict[str, object] = {"stressor": stressor, "level": f"{level:g} {unit}".strip()}
        for preset in trials.preset.unique():
            key = (stressor, level, preset)
            row[preset] = format_fraction(within[key]) if key in within else ""
            row[f"{preset}, within {ROUGH_DEGREES:g}°"] = f"{100 * rough[key].mean:.0f} %" if key in rough else ""
        group = (ours.stressor == stressor) & (ours.level == level)
        row[f"wrong at confidence > {_SURE:g}"] = misleading[group].sum()
        size = ours.size_error[group].abs().median()
        row["size error (median)"] = "" if pd.isna(size) else f"{100 * size:.1f} %"
        yield row


def _risk_and_coverage(trials: pd.DataFrame) -> Iterable[dict[str, object]]:
    """Yield by least confidence: the fraction of all fits, of wrong ones among them, and of all right fits."""
    right = successes(trials)
    for least in _THRESHOLDS:
        kept = right[trials.confidence >= least]
        yield {
            "confidence from": f"{least:g}",
            "fits (coverage)": _ratio(len(kept), len(trials)),
            "wrong ones of these (risk)": _ratio(int((~kept).sum()), len(kept)),
            "of the right ones": _ratio(int(kept.sum()), int(right.sum())),
        }


def _ratio(count: int, total: int) -> str:
    return f"{100 * count / total:.0f} %" if total else ""


# Photographs


def photos_table(trials: pd.DataFrame) -> str:
    """Format a line per photo, and one per category."""
    sides = {True: "right", False: "wrong"}
    rows = (
        {
            "photo": row.photo,
            "box": row.detected,
            "cut out": row.cut_out,
            "sure of it": f"{row.mask_confidence:.2f}",
            "taken for": row.taken_for,
            "side": sides.get(row.right_side, "none"),
            "confidence": f"{row.confidence:.2f}",
            "PSNR": f"{row.psnr:.1f}",
            "s": f"{row.seconds:.1f}",
        }
        for row in trials.itertuples()
    )
    summaries = [_category_summary(str(category), group) for category, group in trials.groupby("category")]
    heading = f"{trials.preset[0]} without a hint; sides and boxes by eye ({trials.machine[0]})."
    return _text(heading, *summaries, markdown(rows))


def _category_summary(category: str, trials: pd.DataFrame) -> str:
    right = (trials.taken_for == category) & (trials.right_side == True)  # noqa: E712 - None and NaN are neither
    wrong = trials.confidence[~right & trials.right_side.notna()]
    whole, in_part, wrongly = ((trials.cut_out == grade).sum() for grade in ("whole", "part", "wrong"))
    cut = f"cut out whole {whole}, in part {in_part}, wrongly {wrongly}"
    counts = f"right model {(trials.taken_for == category).sum()}, right side {right.sum()}"
    return f"{len(trials)} {category}: {cut}; {counts}; surest wrong camera {max(wrong, default=0.0):.2f}."
