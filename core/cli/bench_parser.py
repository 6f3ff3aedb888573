"""The command line of ``bench``. Imports no torch, so that ``--help`` answers at once."""

import argparse
from collections.abc import Callable
from pathlib import Path

from core.cli.argument_types import count, number_from, whole_from
from core.cli.options import add_command, add_device, add_model, add_seed


def add_bench(commands: argparse._SubParsersAction) -> None:
    """Add ``bench`` and its kinds."""
    parser = commands.add_parser("bench", help="measure on this machine and plot charts")
    kinds = parser.add_subparsers(required=True, metavar="KIND")
    for name, (help_text, *option_adders) in _KINDS.items():
        kind = add_command(kinds, name, f"measure.bench_{name}", help_text)
        for add in option_adders:
            add(kind)
        kind.add_argument("--out", type=Path, default=Path("assets/charts"), metavar="DIR", help="folder of the charts")


def _add_fits(kind: argparse.ArgumentParser) -> None:
    """Add the objects of a benchmark of fits."""
    kind.add_argument("--dataset", type=Path, nargs="+", metavar="D", help="SRN folders (default: training objects)")
    kind.add_argument("--objects", type=count, default=10, metavar="N", help="one view of each is fitted")
    add_seed(kind)


def _add_robustness(kind: argparse.ArgumentParser) -> None:
    kind.add_argument("--stressors", nargs="+", default=[], metavar="S", help="stressors to run (default: all)")
    kind.add_argument("--presets", nargs="+", default=["normal", "paper"], metavar="P", help="presets to compare")


def _add_photos(kind: argparse.ArgumentParser) -> None:
    kind.add_argument("folders", type=Path, nargs="+", metavar="DIR", help="folders of the photographs")
    kind.add_argument(
        "--by-eye", type=Path, default=Path("assets/charts/photos_by_eye.csv"), metavar="CSV", help="judgements by eye"
    )
    kind.add_argument("--preset", default="normal", metavar="P", help="of the fits")


def _add_candidates(kind: argparse.ArgumentParser) -> None:
    kind.add_argument("datasets", type=Path, nargs="+", metavar="DATASET", help="folders or packs to train on")
    kind.add_argument("--judge", type=Path, nargs="+", required=True, metavar="D", help="held-out objects to fit")
    kind.add_argument("--regular", type=Path, metavar="D", help="of the datasets, the one of regular objects")
    length = kind.add_mutually_exclusive_group()
    length.add_argument("--seconds", type=number_from(1, 1e6), metavar="S", help="training of each, after first steps")
    length.add_argument("--steps", type=count, default=10, metavar="N", help="training of each, instead: a dry run")
    kind.add_argument("--rays", type=count, default=32768, metavar="N", help="per step")
    kind.add_argument("--latent", type=count, nargs=2, default=(64, 32), metavar=("SHAPE", "TEXTURE"), help="of codes")
    kind.add_argument("--only", nargs="+", default=[], metavar="NAME", help="candidates to train (default: all)")
    kind.add_argument("--objects", type=count, metavar="N", help="held-out objects to fit (default: all)")
    kind.add_argument("--views", type=whole_from(1, 6), default=6, metavar="N", help="fitted views of each, 1 to 6")
    kind.add_argument("--preset", choices=("draft", "normal", "fine"), default="normal", help="of the fits")
    add_device(kind)


def _add_write(kind: argparse.ArgumentParser) -> None:
    kind.add_argument("--write", action="store_true", help="write gate.csv, the baseline, instead")


_KINDS: dict[str, tuple[str, *tuple[Callable[[argparse.ArgumentParser], object], ...]]] = {
    "fit": ("seconds against degrees of fits without a known camera, by preset", _add_fits, add_model),
    "ablations": ("fits without single components of the method", _add_fits, add_model),
    "robustness": ("where fits fail: success rate against stressors", _add_robustness, _add_fits, add_model),
    "candidates": ("train candidates for a better model and judge each by fits of held-out objects", _add_candidates),
    "photos": ("fits of photographs, compared with judgement by eye", _add_photos),
    "gate": ("fail if anything takes twice as long as in gate.csv", _add_write),
    "redraw": ("write tables and charts again from the CSV files",),
}  # help text of each kind, and functions that add its options
