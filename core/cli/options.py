"""Options shared by several commands."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from core.cli.argument_types import image_size, model_name, number_from, whole_from


class _Formatter(argparse.ArgumentDefaultsHelpFormatter):
    """Shows the defaults of options that their help does not tell, except None, False and empty ones."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        has_default = action.default not in (None, [], ()) and action.default is not False
        is_told = "(default: " in (action.help or "")
        return super()._get_help_string(action) if has_default and not is_told else action.help


def add_command(commands: argparse._SubParsersAction, name: str, run: str, description: str) -> argparse.ArgumentParser:
    """Add a command that runs the function ``run``, given as ``module.function`` of core.cli."""
    command = commands.add_parser(
        name, help=description, description=description, formatter_class=_Formatter, allow_abbrev=False
    )
    command.set_defaults(run=run)
    threads = "threads that compute (default: $CODENERF_THREADS, else one for each core)"
    option(command, "--threads", whole_from(1, 1024), "N", threads)
    return command


def option(
    group: argparse._ActionsContainer, name: str, kind: Callable[[str], Any], value: str, text: str, **more: Any
) -> None:
    """Add an option or argument. One with several values may be repeated.

    Args:
        kind: parses its value.
        value: stands for its value in the help.
        text: describes it in the help.
        more: further arguments of :meth:`argparse.ArgumentParser.add_argument`.
    """
    action = "extend" if "nargs" in more else "store"
    group.add_argument(name, type=kind, metavar=value, help=text, **{"action": action, **more})


def add_model(command: argparse.ArgumentParser) -> None:
    """Add ``--model`` and ``--device``."""
    option(command, "--model", model_name, "M", "a shipped name or the path of a model file", default="chairs")
    add_device(command)


def add_device(command: argparse.ArgumentParser) -> None:
    """Add ``--device``."""
    command.add_argument("--device", choices=("cpu", "cuda"), default="cpu", help="where the network runs")


def add_pose_scale(command: argparse.ArgumentParser) -> None:
    """Add ``--pose-scale``."""
    scale = "scene units of a unit of the pose files; an object's diagonal is 1 scene unit"
    option(command, "--pose-scale", number_from(1e-6, 1e6), "X", scale, default=1.0)


def add_seed(command: argparse.ArgumentParser) -> None:
    """Add ``--seed``."""
    command.add_argument("--seed", type=whole_from(0, 2**32 - 1), default=0, help="random seed")


def add_out(command: argparse.ArgumentParser, names: str, description: str = "") -> None:
    """Add the required ``--out``; ``names`` shows the endings that it may have."""
    option(command, "--out", Path, names, description, required=True)


def add_datasets(command: argparse.ArgumentParser, description: str = "folders in the layout of SRN or NeRF") -> None:
    """Add the folders of datasets."""
    option(command, "datasets", Path, "DATASET", description, nargs="+")


def add_size(command: argparse.ArgumentParser, side: int) -> None:
    """Add ``--size`` of images that have ``side`` px by default."""
    option(command, "--size", image_size, "PX|WxH", f"(default: {side})", default=(side, side))
