"""Training curves: PSNR on held-out views against steps and seconds, as JSON and as a chart."""

from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from core.runtime.files import write_json
from core.runtime.reading import read_json, reading, typed


@dataclass(frozen=True)
class CurvePoint:
    """One measurement during a training run."""

    step: int
    seconds: float  # of training
    psnr: float  # dB on views not trained on


def read_curve(path: Path) -> list[CurvePoint]:
    """Read the points of a curve that :func:`write_curve` wrote; none if there is no file."""
    if not path.exists():
        return []
    with reading(path, "a training curve"):
        (points,) = typed(dict[str, tuple[CurvePoint, ...]], read_json(path), name="curve").values()
        return list(points)


def write_curve(path: Path, name: str, points: list[CurvePoint]) -> None:
    """Write JSON to ``path`` and, with matplotlib, a PNG chart beside it: PSNR against minutes."""
    write_json(path, {name: [asdict(point) for point in points]})
    with suppress(ImportError):  # the chart is extra; training needs no matplotlib
        from matplotlib.figure import Figure

        figure = Figure(figsize=(5.2, 4.16), layout="constrained")
        axes = figure.subplots()
        axes.plot([point.seconds / 60 for point in points], [point.psnr for point in points], "o-", label=name)
        axes.set(xlabel="minutes of training", ylabel="PSNR on held-out views (dB)")
        axes.grid(alpha=0.3)
        axes.legend()
        figure.savefig(path.with_suffix(".png"), dpi=110)
