"""``evaluate`` and ``bench``: how good, how fast, and where it fails."""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypeVar

import torch
from tqdm import tqdm

from core.benchmarks import ablations, charts, rendering
from core.benchmarks import fits as fitting
from core.benchmarks import model_sizes as sizes
from core.benchmarks import robustness as stability
from core.benchmarks.held_out_views import Subject, dataset_subjects, own_subjects
from core.cli.progress import require_place
from core.datasets.srn import ObjectPlace, find_objects
from core.evaluation.disentanglement import CellScore, swap, table
from core.evaluation.protocol import ObjectScore, Protocol
from core.evaluation.protocol import evaluate as scored
from core.evaluation.report import swap_told, told, write_report, write_swap_report
from core.models.library import load_model
from core.models.model import Model

_Score = TypeVar("_Score", ObjectScore, CellScore)
_Thing = TypeVar("_Thing")
_Found = TypeVar("_Found")


def evaluate(chosen: argparse.Namespace) -> None:
    """``evaluate``: the paper's table on a test set, or with ``--swap`` how well shape and texture are told apart."""
    protocol = Protocol(chosen.inputs, chosen.pose == "estimate", chosen.preset, chosen.seed, chosen.every)
    if chosen.swap and protocol != Protocol(seed=chosen.seed):
        raise ValueError("--swap draws all of a cell from its true cameras: no --inputs, --pose, --preset or --every")
    model = load_model(chosen.model, chosen.device)
    places = _places(model, chosen.datasets)
    if chosen.report:
        require_place(chosen.report)
    about = {"model": model.fingerprint, "datasets": " ".join(map(str, chosen.datasets))}
    if chosen.swap:
        _evaluate_swap(chosen, model, places, about)
        return
    places = _spread(places, chosen.objects)
    scores = _collected(scored(model, (place.read() for place in places), protocol), len(places))
    print(told(scores, protocol), flush=True)
    if chosen.report:
        write_report(chosen.report, scores, protocol, about)


def bench_render(chosen: argparse.Namespace) -> None:
    """``bench render``: speed and accuracy of the renderer, as numbers, table and chart."""
    charts.prepare(chosen.out)
    found = _watched(rendering.measured(load_model(chosen.model, chosen.device), chosen.views))
    charts.write_rendering(found, chosen.out)
    print(charts.rendering_table(found), flush=True)


def bench_fit(chosen: argparse.Namespace) -> None:
    """``bench fit``: speed and accuracy of blind fits, as numbers, table and chart."""
    charts.prepare(chosen.out)
    found = _watched(fitting.measured(*_subjects(chosen)))
    charts.write_fitting(found, chosen.out)
    print(charts.fitting_table(found), flush=True)


def bench_parts(chosen: argparse.Namespace) -> None:
    """``bench parts``: blind fits without each part of the method, as numbers, table and chart."""
    charts.prepare(chosen.out)
    found = _watched(ablations.run(*_subjects(chosen)))
    charts.write_ablations(found, chosen.out)
    print(charts.ablations_table(found), flush=True)


def bench_stability(chosen: argparse.Namespace) -> None:
    """``bench stability``: the atlas of where fits fail, as numbers, table and chart."""
    charts.prepare(chosen.out)
    found = _watched(stability.measured(load_model(chosen.model, chosen.device), chosen.objects, chosen.seed))
    charts.write_stability(found, chosen.out)
    print(charts.stability_table(found), flush=True)


def bench_size(chosen: argparse.Namespace) -> None:
    """``bench size``: what sizes of network and codes buy, as numbers, table and chart."""
    charts.prepare(chosen.out)
    if not chosen.models.is_dir():
        raise ValueError(f"there is no folder {chosen.models}")
    tests = _spread(find_objects(chosen.tests)[1], chosen.objects)
    found = _watched(sizes.measured(chosen.datasets, tests, chosen.steps, chosen.models))
    charts.write_sizes(found, chosen.out)
    print(charts.sizes_table(found), flush=True)


def _subjects(chosen: argparse.Namespace) -> tuple[Model, tuple[Subject, ...]]:
    model = load_model(chosen.model, chosen.device)
    generator = torch.Generator().manual_seed(chosen.seed)
    if not chosen.dataset:
        return model, tuple(own_subjects(model, chosen.objects, generator))
    places = _spread(_places(model, chosen.dataset), chosen.objects)
    return model, tuple(dataset_subjects(model, places, generator))


def _watched(stream: Iterator[str | _Found]) -> _Found:
    """The last value of a benchmark, whose words until then are shown beside the time."""
    with tqdm(bar_format="{desc} {elapsed}", disable=None) as bar:
        for value in stream:
            if not isinstance(value, str):
                return value
            bar.set_description_str(value)
    raise ValueError("the benchmark found nothing")


def _evaluate_swap(
    chosen: argparse.Namespace, model: Model, places: tuple[ObjectPlace, ...], about: dict[str, str]
) -> None:
    cells = table(model, places)
    kinds = ([cell for cell in cells if cell.trained == trained] for trained in (False, True))
    some = [cell for kind in kinds for cell in _spread(tuple(kind), chosen.objects)]
    scores = _collected(swap(model, some, chosen.seed), len(some))
    print(swap_told(scores), flush=True)
    if chosen.report:
        write_swap_report(chosen.report, scores, about)


def _places(model: Model, datasets: Sequence[Path]) -> tuple[ObjectPlace, ...]:
    """The objects of datasets, which must be of the model's category."""
    category, places = find_objects(datasets)
    if category and model.category not in ("", category):
        raise ValueError(f"the dataset shows {category}, and the model knows {model.category}")
    return places


def _collected(scores: Iterator[_Score], total: int) -> list[_Score]:
    """All scores of a stream, under a bar that shows their mean."""
    found = []
    with tqdm(total=total, unit="object", disable=None) as bar:
        for score in scores:
            found.append(score)
            bar.set_postfix_str(f"{sum(one.psnr for one in found) / len(found):.2f} dB")
            bar.update()
    return found


def _spread(things: tuple[_Thing, ...], count: int | None) -> tuple[_Thing, ...]:
    """So many of them, evenly spread."""
    if count is None or count >= len(things):
        return things
    return tuple(things[index * len(things) // count] for index in range(count))
