"""``bench``: speed, accuracy and failures of fits, and candidates for a better model."""

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from functools import partial
from multiprocessing import get_context
from typing import Any, TypeVar

import torch
from tqdm import tqdm

from core.cli.evaluate import index_entries
from core.cli.output import say
from core.cli.progress import wait_for_view_bank
from core.fitting.settings import PRESETS
from core.lab.benchmarks import ablations, candidates, charts, fits, gate, photos, robustness
from core.lab.benchmarks.held_out_views import HeldOutView, dataset_views, training_object_views
from core.lab.benchmarks.machine import describe_machine
from core.lab.benchmarks.results import append_row, frame_of, keys_of, read_frame, write_frame
from core.lab.datasets.splits import evenly_spaced
from core.lab.datasets.srn import Dataset, index_objects, read_dataset
from core.lab.training.recipes import TrainSettings
from core.models.library import DEFAULT_MODEL, load_model
from core.models.model import Model
from core.runtime.threads import thread_count, use_threads

_Item = TypeVar("_Item")


def bench_gate(chosen: argparse.Namespace) -> None:
    """Run ``bench gate``: exit with status 1 if anything takes twice as long as the baseline."""
    path = chosen.out / "gate.csv"
    baseline = () if chosen.write else gate.read_baseline(path)
    model = load_model(DEFAULT_MODEL)
    wait_for_view_bank(model)
    ratios = list(_reported(gate.measure_ratios(model)))
    if chosen.write:
        write_frame(path, frame_of(ratios))
    elif lines := gate.compare(ratios, baseline):
        raise SystemExit(f"more than {gate.TOLERANCE:g} times the baseline: {'; '.join(lines)}")


def bench_fit(chosen: argparse.Namespace) -> None:
    """Run ``bench fit``: speed and accuracy of blind fits."""
    model, views = _held_out_views(chosen)
    methods = {name: fits.FitMethod(preset) for name, preset in PRESETS.items()}
    conditions = {"machine": describe_machine(model.device), "model": model.fingerprint}
    _bench(chosen, "fit", conditions, partial(fits.fit_views, model, views, methods))


def bench_ablations(chosen: argparse.Namespace) -> None:
    """Run ``bench ablations``: blind fits without each component of the method."""
    chosen.out.mkdir(parents=True, exist_ok=True)
    model, views = _held_out_views(chosen)
    trials = frame_of(_reported(fits.fit_views(model, views, ablations.ABLATIONS)))
    conditions = {"machine": describe_machine(model.device)}
    write_frame(chosen.out / "ablations.csv", frame_of(ablations.summarise_ablations(trials), conditions))
    print(charts.draw(chosen.out, "ablations"), flush=True)


def bench_robustness(chosen: argparse.Namespace) -> None:
    """Run ``bench robustness``: failures of blind fits."""
    model, views = _held_out_views(chosen)
    conditions = {"machine": describe_machine(model.device)}
    measure = partial(robustness.measure_robustness, model, views, chosen.stressors, chosen.presets, chosen.seed)
    _bench(chosen, "robustness", conditions, measure)


def bench_photos(chosen: argparse.Namespace) -> None:
    """Run ``bench photos``: fits of photographs against judgement by eye."""
    judgements = photos.read_judgements(chosen.by_eye)
    conditions = {"machine": describe_machine(torch.device("cpu")), "preset": chosen.preset}
    files = [file for folder in chosen.folders for file in sorted(folder.iterdir()) if file.stem in judgements]
    if not files:
        raise ValueError(f"{chosen.by_eye}: none of its photos is in {', '.join(map(str, chosen.folders))}")
    measure = partial(photos.measure_photos, files, judgements, chosen.preset)
    _bench(chosen, "photos", conditions, measure)


def bench_candidates(chosen: argparse.Namespace) -> None:
    """Run ``bench candidates``: train candidates for a better model, and judge them in processes of their own."""
    dataset = read_dataset(chosen.datasets)
    category, entries = index_objects(chosen.judge)
    if category != dataset.category:
        raise ValueError(f"{category} cannot judge models of {dataset.category}")
    entries = evenly_spaced(entries, chosen.objects)
    conditions = {
        "machine": describe_machine(torch.device(chosen.device)),
        "objects": str(len(entries)),
        "budget": f"{chosen.seconds} s" if chosen.seconds else f"{chosen.steps} steps",
        "rays": str(chosen.rays),
        "preset": chosen.preset,
    }
    with ExitStack() as stack:
        measure = partial(
            candidates.measure_candidates,
            dataset,
            candidates.judged_cases(entries, chosen.views),
            _chosen_candidates(chosen, dataset),
            candidates.Budget(chosen.seconds, chosen.steps),
            PRESETS[chosen.preset],
            out=chosen.out,
            device=chosen.device,
            pool=_processes(chosen, stack),
            report=say,
        )
        try:
            _bench(chosen, "candidates", conditions, lambda done: measure(done=done))
        except ValueError:  # of some candidates or fits: show the table of the rest
            if (chosen.out / "candidates.csv").exists():
                print(charts.draw(chosen.out, "candidates"), flush=True)
            raise


def _processes(chosen: argparse.Namespace, stack: ExitStack) -> ProcessPoolExecutor:
    """Return processes of one thread each, one per thread of the command; ``stack`` ends them."""
    workers = max(1, thread_count() - (chosen.device == "cuda"))  # training keeps a core busy
    context = get_context("spawn")  # a graphics card does not survive a fork
    pool = ProcessPoolExecutor(workers, context, use_threads, (1,))
    stack.callback(pool.shutdown, cancel_futures=True)
    return pool


def _chosen_candidates(chosen: argparse.Namespace, dataset: Dataset) -> dict[str, TrainSettings]:
    """Return the candidates to train. Raises ``ValueError`` for unknown names."""
    if chosen.regular and chosen.regular not in chosen.datasets:
        raise ValueError(f"--regular {chosen.regular} is none of the datasets")
    regular = chosen.datasets.index(chosen.regular) if chosen.regular else None
    counts = [dataset.sources.count(number) for number in range(len(chosen.datasets))]
    every = candidates.candidates(counts, regular, chosen.rays, tuple(chosen.latent))
    if unknown := set(chosen.only) - set(every):
        raise ValueError(f"no candidate {', '.join(sorted(unknown))}: choose from {', '.join(every)}")
    return {name: settings for name, settings in every.items() if name in chosen.only or not chosen.only}


def bench_redraw(chosen: argparse.Namespace) -> None:
    """Run ``bench redraw``: write tables and charts again from the CSV files."""
    for path in charts.redraw(chosen.out):
        print(path, flush=True)


def _held_out_views(chosen: argparse.Namespace) -> tuple[Model, tuple[HeldOutView, ...]]:
    """Return the model, with its view bank built, and the views to measure."""
    model = load_model(chosen.model, chosen.device)
    wait_for_view_bank(model)
    generator = torch.Generator().manual_seed(chosen.seed)
    if not chosen.dataset:
        return model, tuple(training_object_views(model, chosen.objects, generator))
    entries = evenly_spaced(index_entries(model, chosen.dataset), chosen.objects)
    return model, tuple(dataset_views(model, entries, generator))


def _bench(
    chosen: argparse.Namespace,
    name: str,
    conditions: Mapping[str, str],
    measure: Callable[[set[Any]], Iterator[Any]],
) -> None:
    """Measure a benchmark's missing rows into its CSV file; write its table and chart.

    Args:
        conditions: the conditions of the rows, such as the machine.
        measure: yields the rows whose keys are not in its argument, the keys of an earlier run.
    """
    chosen.out.mkdir(parents=True, exist_ok=True)
    path = chosen.out / f"{name}.csv"
    key = charts.CHARTS[name].key
    done = keys_of(read_frame(path, key, conditions), key) if path.exists() else set()
    for row in _reported(measure(done)):
        append_row(path, conditions, row)
    print(charts.draw(chosen.out, name), flush=True)


def _reported(rows: Iterator[_Item]) -> Iterator[_Item]:
    """Yield each row and print it to stderr."""
    for row in rows:
        tqdm.write(str(row), file=sys.stderr)
        yield row
