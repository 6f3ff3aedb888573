"""The page of charts: its tables and sentences with numbers, filled from the frames of the benchmarks' rows.

A block of the page begins with ``<!-- NAME -->`` and ends with ``<!-- end -->``; between them stands what the function
of that name in :data:`BLOCKS` returns: a table in lines of its own, or sentences within a line. All else is written by
hand.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path

import pandas as pd

from core.fitting.confidence import RIGHT_DEGREES, auroc, fit_calibration
from core.lab.benchmarks.bench import BENCHMARKS
from core.lab.benchmarks.charts import CHARTS, Frames, draw, level_rows
from core.lab.benchmarks.fits import DEFAULT, LEVELS, SPEED, WITHOUT
from core.lab.benchmarks.frames import SIZES
from core.lab.benchmarks.pictures import EXCHANGE, FAILURE, PHOTOS
from core.lab.benchmarks.results import read_frame
from core.lab.benchmarks.stability import surest_mistakes, wrong_and_sure
from core.lab.benchmarks.stressors import STRESSORS
from core.lab.evaluation.protocol import format_difference, mean_of

PAGE = "README.md"
SURE_FROM = 0.8  # confidence above which no camera is to be wrong
_USUAL_FRAMES = ("exact", 128), ("fast", 192), ("baked", 128)
_BANDS = (0.0, 0.5, 0.8, 1.0)  # edges of bands of confidence
_MISSING = "Not measured yet."

_Cell = Callable[[pd.DataFrame], str]  # describes rows


def write_page(folder: Path) -> list[Path]:
    """Draw the charts of a folder's CSV files and fill its page, if any; return these. ``ValueError`` without CSV."""
    frames = read_frames(folder)
    if not frames:
        raise ValueError(f"{folder}: no CSV file of a benchmark in it")
    page = folder / PAGE
    written = draw(frames, folder)
    if page.exists():
        page.write_text(fill(page.read_text(encoding="utf-8"), frames), encoding="utf-8")
        written.append(page)
    return written


def read_frames(folder: Path) -> dict[str, pd.DataFrame]:
    """Return the rows of all benchmarks measured in a folder."""
    paths = {name: folder / f"{name}.csv" for name in BENCHMARKS}
    return {name: read_frame(path) for name, path in paths.items() if path.exists()}


def fill(page: str, frames: Frames) -> str:
    """Return a page with all of its blocks filled anew. Raise ``ValueError`` for an unknown block."""

    def block(match: re.Match[str]) -> str:
        name = match[1]
        if name not in BLOCKS:
            raise ValueError(f"the page has no block {name!r}; there are {', '.join(BLOCKS)}")
        needed, write = BLOCKS[name]
        content = write(frames) if set(needed) <= set(frames) else _MISSING
        return f"<!-- {name} -->{match[2]}{content}{match[2]}<!-- end -->"

    return re.sub(r"<!-- (\w+) -->(\n?).*?\n?<!-- end -->", block, page, flags=re.DOTALL)


def markdown(rows: Iterable[Mapping[str, object]]) -> str:
    """Format rows of cells by heading as a Markdown table.

    Example:
        >>> print(markdown([{"ms": "1.2", "twice": 2}]))
        | ms | twice |
        | --- | --- |
        | 1.2 | 2 |
    """
    table = pd.DataFrame(list(rows)).astype(str)
    head, *body = ("| " + " | ".join(line) + " |" for line in ([*table.columns], *table.to_numpy()))
    return "\n".join((head, "| " + " | ".join(["---"] * table.shape[1]) + " |", *body))


def _table(heading: str, groups: Iterable[tuple[str, pd.DataFrame]], columns: Mapping[str, _Cell]) -> str:
    """Format a line for each group of rows that is not empty, with the number of its rows."""
    lines = [
        {heading: name, "n": len(group), **{title: cell(group) for title, cell in columns.items()}}
        for name, group in groups
        if len(group)
    ]
    return markdown(lines) if lines else _MISSING


def _each(describe: _Cell) -> _Cell:
    """Return a cell that describes the rows of each category, chairs first."""
    return lambda frame: "; ".join(describe(group) for _, group in frame.groupby("category", sort=False))


def _mean(column: str, digits: int = 1, scale: float = 1.0) -> _Cell:
    """Return a cell of a column's mean for each category."""
    return _each(lambda group: f"{scale * group[column].mean():.{digits}f}")


def _of_cases(trials: pd.DataFrame, titles: Mapping[str, str]) -> list[tuple[str, pd.DataFrame]]:
    return [(title, trials[trials.case == case]) for case, title in titles.items()]


def _origin(frames: Frames) -> str:
    """Say when, by which code and on which objects everything was measured."""
    rows = pd.concat(frame[["category", "name", "commit", "processor", "date"]] for frame in frames.values())
    objects = ", ".join(f"{group.name.nunique()} {kind}" for kind, group in rows.groupby("category", sort=False))
    commits = " and ".join(sorted(set(rows.commit)))
    processors = " and ".join(sorted(set(rows.processor)))
    return f"Measured until {rows.date.max()} by commit {commits} on {processors}, on {objects}."


# Speed


def _speed_sentences(frames: Frames) -> str:
    def sentence(group: pd.DataFrame) -> str:
        seconds = group.groupby("case").seconds.median().reindex(list(SPEED))
        worth = (
            group.groupby("case")["novel.psnr"].mean().reindex(list(SPEED))
            - group["novel.psnr"][group.case == DEFAULT].mean()
        )
        compared = {"draft": "`draft`", "paper": "the paper's recipe"}
        costs = ", ".join(f"{name} {worth[case]:+.1f} dB in {seconds[case]:.1f} s" for case, name in compared.items())
        return f"{group.category.iloc[0].capitalize()}: `normal` takes {seconds[DEFAULT]:.1f} s of one core, {costs}"

    return f"{_each(sentence)(frames['fits'])}."


def _speed_table(frames: Frames) -> str:
    titles = {name: f"**{name}**" if name == DEFAULT else name for name in SPEED}
    columns = {
        "seconds": _each(lambda group: f"{group.seconds.median():.1f}"),
        f"within {RIGHT_DEGREES:g}° (%)": _mean("right", 0, 100),
        "other views (dB)": _mean("novel.psnr"),
    }
    return _table("method", _of_cases(frames["fits"], titles), columns)


def _frames_sentence(frames: Frames) -> str:
    """State time and error of each renderer's usual setting at the middle size."""
    timings = frames["frames"][frames["frames"]["size"] == SIZES[1]]
    means = timings.groupby(["renderer", "samples"])[["milliseconds", "psnr"]].mean()
    usual = means[means.index.isin(_USUAL_FRAMES)].sort_values("milliseconds")
    costs = [f"{name} {row.milliseconds:,.0f} ms, {row.psnr:.0f} dB" for (name, _), row in usual.iterrows()]
    return f"At {SIZES[1]} px: {'; '.join(costs)} (n = {timings.name.nunique()})."


def _exports_sentence(frames: Frames) -> str:
    groups = frames["exports"].groupby("case", sort=False)
    costs = [f"{case} {group.seconds.mean():.1f} s, {group.megabytes.mean():.1f} MB" for case, group in groups]
    return f"Means of {frames['exports'].name.nunique()} objects: {'; '.join(costs)}."


# Stability


def _stability_sentences(frames: Frames) -> str:
    ours = frames["stability"][frames["stability"].method == DEFAULT]
    rates = []
    for name, stressor in STRESSORS.items():
        hardest = stressor.levels[-1]
        title = f"{stressor.title}, {hardest:g} {stressor.unit}" if stressor.unit else stressor.title
        group = ours[(ours.stressor == name) & (ours.level == hardest)]
        if len(group):
            rates.append((group.right.mean(), title.lower()))
    names = "; ".join(f"{title} ({100 * rate:.0f} %)" for rate, title in sorted(rates)[:3])
    wrong = ours[~ours.right]
    sure = int(wrong_and_sure(ours, SURE_FROM).sum())
    doubts = f"of {len(wrong)} wrong results among {len(ours)}, the program doubts {wrong.doubted.sum()}"
    sure_ones = f"{sure} are wrong and sure (from {SURE_FROM:g} on)"
    return f"At the hardest level, least is right with: {names}; {doubts}; {sure_ones}."


def _confidence_sentence(frames: Frames) -> str:
    """Compare stated confidence with the observed fraction of right cameras, over all single unknown cameras."""
    fits = frames["fits"]
    fits = fits[(fits.case.isin(SPEED)) & (fits.photos == 1)].assign(right=lambda rows: rows.right > 0.5)
    sources = [fits, *([frames["stability"]] if "stability" in frames else [])]
    rated = pd.concat(source[["right", "confidence"]] for source in sources).dropna()
    bands = pd.cut(rated.confidence, _BANDS, include_lowest=True)
    texts = [
        f"up to {band.right:g}, {group.confidence.mean():.2f} and {group.right.mean():.2f} ({len(group)})"
        for band, group in rated.groupby(bands, observed=True)
    ]
    both = rated.right.nunique() == 2
    area = f"{auroc(rated.confidence.tolist(), rated.right.tolist()):.2f}" if both else "not defined"
    return f"Confidence stated and observed (fits): {'; '.join(texts)}. AUROC {area}{_calibration(fits)}."


def _calibration(fits: pd.DataFrame) -> str:
    """Describe the constants that these fits alone would give; nothing if all cameras are right, or all wrong."""
    rated = fits.dropna(subset=["margin", "uncertainty"])
    if rated.right.nunique() < 2:
        return ""
    calibration = fit_calibration(rated.margin.tolist(), rated.uncertainty.tolist(), rated.right.tolist())
    numbers = ", ".join(f"{name} {value:.2f}" for name, value in calibration._asdict().items())
    return f"; calibrated on the clean fits alone: {numbers}"


# Freedom


def _freedom_sentences(frames: Frames) -> str:
    sentences = []
    for photos, group in level_rows(frames["fits"]).groupby("photos"):
        worth = group.groupby("level")["novel.psnr"].mean().reindex(list(LEVELS))
        gains = worth[["all codes", "biases", "network"]].diff().dropna()
        words = ", ".join(f"{level} {gain:+.1f} dB" for level, gain in gains.items())
        sentences.append(f"{photos}: {worth.idxmax()}, {worth.max():.1f} dB; over the level before, {words}")
    return f"Best for other views, by the number of photos: {'. '.join(sentences)}."


def _parts_table(frames: Frames) -> str:
    """Compare fits without a component with the default on the same views."""
    trials = frames["fits"]
    key = ["category", "name", "number"]
    full = trials[trials.case == DEFAULT]
    groups = [(name, trials[trials.case == name].merge(full, on=key, suffixes=("", " full"))) for name in WITHOUT]
    columns: dict[str, _Cell] = {
        "other views (dB)": lambda both: format_difference(mean_of(both["novel.psnr"] - both["novel.psnr full"])),
        "cameras": lambda both: f"{(both.right - both['right full']).sum():+.0f}",
        "time": lambda both: f"{(both.seconds / both['seconds full']).median():.2f}",
    }
    return _table("default", groups, columns)


# The paper's evaluation


def _reconstruction_table(frames: Frames) -> str:
    columns = {"PSNR (dB)": _mean("novel.psnr"), "SSIM": _mean("novel.ssim", 3), "overlap": _mean("novel.overlap", 2)}
    return _table("input", _of_cases(frames["fits"], _RECONSTRUCTION), columns)


def _exchange_sentence(frames: Frames) -> str:
    trials = frames["disentanglement"]
    worths = ", ".join(f"{title} {_mean(name)(trials)} dB" for name, title in _EXCHANGE.items())
    return f"Largest change of opacity: {trials.opacity.max():.2g}. Against the renders: {worths} (n = {len(trials)})."


# Pictures


def _link(name: str, _: Frames) -> str:
    return f"![{CHARTS[name].title}]({name}.png)"


def _failure_picture(frames: Frames) -> str:
    if surest_mistakes(frames["stability"]).empty:
        return "No fit of a photo was wrong."
    return f"![The photo, the fit from its camera, another true view, the fit from there]({FAILURE})"


_RECONSTRUCTION = {
    "biases, 1": "1 view",
    "biases, 2": "2 views",
    "network, 3": "3 views",
    DEFAULT: "1 view, camera unknown",
    "paper, 1 posed": "the paper's recipe, 1 view",
    "paper, 2 posed": "the paper's recipe, 2 views",
    "paper": "the paper's recipe, 1 view, camera unknown",
}
_EXCHANGE = {"exchanged": "the fit", "shape": "its shape in the first texture", "texture": "its texture on its object"}
_Block = tuple[tuple[str, ...], Callable[[Frames], str]]

BLOCKS: dict[str, _Block] = {
    "origin": (("fits",), _origin),
    "speed": (("fits",), _speed_sentences),
    "speed_table": (("fits",), _speed_table),
    "frames": (("frames",), _frames_sentence),
    "exports": (("exports",), _exports_sentence),
    "stability": (("stability",), _stability_sentences),
    "confidence": (("fits",), _confidence_sentence),
    "freedom": (("fits",), _freedom_sentences),
    "parts_table": (("fits",), _parts_table),
    "reconstruction_table": (("fits",), _reconstruction_table),
    "exchange": (("disentanglement",), _exchange_sentence),
    "failure_picture": (("stability",), _failure_picture),
    "photos_picture": (("fits",), lambda _: f"![From 1, 2, 3 and 5 photos, and the truth]({PHOTOS})"),
    "exchange_picture": (("disentanglement",), lambda _: f"![Every shape, a row, in every texture]({EXCHANGE})"),
    **{f"{name}_chart": (chart.benchmarks, partial(_link, name)) for name, chart in CHARTS.items()},
}  # the benchmarks that each block needs, and its function
