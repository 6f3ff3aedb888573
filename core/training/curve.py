"""Training curves: PSNR on held-out views against steps and seconds, as JSON and as a chart."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from core.files import write_json


@dataclass(frozen=True)
class CurvePoint:
    """One measurement during a training run."""

    step: int
    seconds: float
    """of training"""
    psnr: float
    """dB on views not trained on"""


def read_curve(path: Path) -> list[CurvePoint]:
    """The points of a curve that :func:`write_curve` wrote; none where there is no file."""
    if not path.exists():
        return []
    try:
        (points,) = json.loads(path.read_text()).values()
        return [CurvePoint(**point) for point in points]
    except (json.JSONDecodeError, UnicodeDecodeError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"{path}: not a training curve ({error})") from None


def write_curve(path: Path, name: str, points: list[CurvePoint]) -> None:
    """``path`` as JSON, and beside it, where matplotlib is installed, a chart as PNG: PSNR against minutes."""
    write_json(path, {name: [asdict(point) for point in points]})
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return
    figure = Figure(figsize=(5.2, 4.16), layout="constrained")
    axes = figure.subplots()
    axes.plot([point.seconds / 60 for point in points], [point.psnr for point in points], "o-", label=name)
    axes.set(xlabel="minutes of training", ylabel="PSNR on held-out views (dB)")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path.with_suffix(".png"), dpi=110)
