"""The command line of ``bench``. Imports no torch, so that ``--help`` answers at once."""

import argparse
from collections.abc import Callable
from pathlib import Path

from core.cli.argument_types import count, number_from
from core.cli.options import add_command, option

BENCHMARK_NAMES = ("fits", "stability", "frames", "exports", "disentanglement")


def add_bench(commands: argparse._SubParsersAction) -> None:
    """Add ``bench`` and its kinds."""
    parser = commands.add_parser("bench", help="measure on this machine and plot charts")
    kinds = parser.add_subparsers(required=True, metavar="KIND")
    for name, (help_text, *option_adders) in _KINDS.items():
        kind = add_command(kinds, name, f"measure.bench_{name}", help_text)
        for add in option_adders:
            add(kind)
        option(kind, "--out", Path, "DIR", "folder of the charts", default=Path("assets/charts"))


def _add_all(kind: argparse.ArgumentParser) -> None:
    kind.add_argument("--quick", action="store_true", help="a few cases and objects in five minutes")
    option(kind, "--minutes", number_from(0, 1e5), "M", "when to stop (default: when all is done)")
    option(kind, "--dataset", Path, "D", "held-out objects (default: assets/benchmark)", nargs="+")
    option(kind, "--objects", count, "N", "of each dataset (default: all; quickly two)")
    option(kind, "--views", count, "N", "fitted views of each object, one after another", default=1)
    kind.add_argument(
        "--only", choices=BENCHMARK_NAMES, nargs="+", metavar="NAME", help=f"some of {', '.join(BENCHMARK_NAMES)}"
    )


def _add_write(kind: argparse.ArgumentParser) -> None:
    kind.add_argument("--write", action="store_true", help="write gate.csv, the baseline, instead")


_KINDS: dict[str, tuple[str, *tuple[Callable[[argparse.ArgumentParser], object], ...]]] = {
    "all": ("measure everything on the page of charts, row by row, and draw it; resumable", _add_all),
    "page": ("draw the charts and fill the page again from the CSV files",),
    "gate": ("fail if anything takes twice as long as in gate.csv", _add_write),
}  # help text of each kind, and functions that add its options
