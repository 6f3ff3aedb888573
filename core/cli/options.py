"""Options shared by several commands."""

import argparse

from core.cli.argument_types import model_name, number_from, whole_from


class _Formatter(argparse.ArgumentDefaultsHelpFormatter):
    """Shows the defaults of options, except None, False and empty lists."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        has_default = action.default not in (None, []) and action.default is not False
        return super()._get_help_string(action) if has_default else action.help


def add_command(commands: argparse._SubParsersAction, name: str, run: str, description: str) -> argparse.ArgumentParser:
    """Add a command that runs the function ``run``, given as ``module.function`` of core.cli."""
    command = commands.add_parser(
        name, help=description, description=description, formatter_class=_Formatter, allow_abbrev=False
    )
    command.set_defaults(run=run)
    threads = "threads that compute (default: $CODENERF_THREADS, else one for each core)"
    command.add_argument("--threads", type=whole_from(1, 1024), metavar="N", help=threads)
    return command


def add_model(command: argparse.ArgumentParser) -> None:
    """Add ``--model`` and ``--device``."""
    command.add_argument(
        "--model", type=model_name, default="chairs", metavar="M", help="a shipped name or the path of a model file"
    )
    add_device(command)


def add_device(command: argparse.ArgumentParser) -> None:
    """Add ``--device``."""
    command.add_argument("--device", choices=("cpu", "cuda"), default="cpu", help="where the network runs")


def add_pose_scale(command: argparse.ArgumentParser) -> None:
    """Add ``--pose-scale``."""
    scale = "scene units of a unit of the pose files; an object's diagonal is 1 scene unit"
    command.add_argument("--pose-scale", type=number_from(1e-6, 1e6), default=1.0, metavar="X", help=scale)


def add_seed(command: argparse.ArgumentParser) -> None:
    """Add ``--seed``."""
    command.add_argument("--seed", type=whole_from(0, 2**32 - 1), default=0, help="random seed")


def add_no_photo_detail(command: argparse.ArgumentParser, description: str) -> None:
    """Add ``--no-photo-detail``."""
    command.add_argument("--no-photo-detail", action="store_true", help=description)
