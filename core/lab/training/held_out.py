"""Views held out of training, and a model's PSNR on them during training, in a file and a chart."""

from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import torch

from core.lab.datasets.srn import Dataset, ObjectViews
from core.metrics import psnr
from core.models.model import Model
from core.rendering.reference import render_exact
from core.runtime.files import write_json
from core.runtime.reading import read_json, reading, typed

_MEASURED_OBJECTS = 8  # objects whose held-out views are compared during training


def hold_out(dataset: Dataset) -> tuple[Dataset, Dataset]:
    """Split off the last view of every object; return the rest, and those views of a few evenly spaced objects."""
    if min(len(views.cameras) for views in dataset.objects) < 2:
        raise ValueError("training needs at least two views of every object: one is held out for validation")
    training = tuple(_selected(views, slice(None, -1)) for views in dataset.objects)
    measured = dataset.objects[:: max(1, len(dataset.objects) // _MEASURED_OBJECTS)][:_MEASURED_OBJECTS]
    held_out = tuple(_selected(views, slice(-1, None)) for views in measured)
    return replace(dataset, objects=training), replace(dataset, objects=held_out, weights=())


def _selected(views: ObjectViews, rows: slice) -> ObjectViews:
    return replace(views, images=views.images[rows], masks=views.masks[rows], cameras=views.cameras[rows])


def held_out_psnr(model: Model, dataset: Dataset, samples: int = 64) -> float:
    """Return the mean PSNR (dB) of a model's training objects over held-out whole images."""
    values = list[float]()
    for views in dataset.objects:
        instance = model[model.codes.index[views.name]]
        for image, camera in zip(views.images, views.cameras, strict=True):
            colour = render_exact(instance, camera, samples).colour.clamp(0, 1)
            values.append(psnr(colour, torch.from_numpy(image).float() / 255))
    return sum(values) / len(values)


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
