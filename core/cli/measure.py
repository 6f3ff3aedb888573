"""``bench``: speed against accuracy, stability and freedom of the present code, and a gate against slowdowns."""

import argparse

from core.cli.output import say
from core.cli.progress import wait_for_view_bank
from core.lab.benchmarks import bench, gate, page, pictures
from core.lab.benchmarks.held_out_views import DATASETS
from core.lab.benchmarks.results import conditions
from core.models.library import DEFAULT_MODEL, load_model

_QUICK_OBJECTS, _QUICK_MINUTES = 2, 5.0  # of each category


def bench_all(args: argparse.Namespace) -> None:
    """Run ``bench all``: measure missing rows until the time is over, then draw charts and pictures, fill the page."""
    datasets = tuple(args.dataset or DATASETS)
    plan = bench.Plan(
        datasets,
        tuple(args.only or bench.BENCHMARKS),
        args.objects or (_QUICK_OBJECTS if args.quick else None),
        args.views,
        args.quick,
        _QUICK_MINUTES if args.quick and args.minutes is None else args.minutes,
    )
    done = bench.run(plan, args.out, conditions(), say)
    frames = page.read_frames(args.out)
    if "fits" in frames and not args.quick:
        pictures.draw_photos(datasets, args.out)
    if "disentanglement" in frames:
        pictures.draw_exchange(datasets, args.out)
    if "stability" in frames:
        pictures.draw_failure(datasets, frames["stability"], args.out)
    bench_page(args)
    if not done:
        say("The time is over: run the same command again to measure the rest")


def bench_page(args: argparse.Namespace) -> None:
    """Run ``bench page``: draw the charts and fill the page again from the CSV files."""
    for path in page.write_page(args.out):
        print(path, flush=True)


def bench_gate(args: argparse.Namespace) -> None:
    """Run ``bench gate``: exit with status 1 if anything takes twice as long as the baseline."""
    path = args.out / "gate.csv"
    baseline = {} if args.write else gate.read_baseline(path)
    model = load_model(DEFAULT_MODEL)
    wait_for_view_bank(model)
    ratios = {}
    for name, value in gate.measure_ratios(model):
        say(f"{name}: {value:.3g}")
        ratios[name] = value
    if args.write:
        gate.write_baseline(path, ratios)
    elif lines := gate.compare(ratios, baseline):
        raise SystemExit(f"more than {gate.TOLERANCE:g} times the baseline: {'; '.join(lines)}")
