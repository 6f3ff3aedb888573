"""The command line, ``python -m core COMMAND``. Degrees here, radians inside."""

import argparse
import math
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import NoReturn


class _Formatter(argparse.ArgumentDefaultsHelpFormatter):
    """Tells defaults, where there are any."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        told = action.default not in (None, []) and action.default is not False
        return super()._get_help_string(action) if told else action.help


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        print(f"{self.prog}: {message}", file=sys.stderr)
        sys.exit(2)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command. Whatever is wrong with its input is said in one line on stderr, with status 2."""
    chosen = parser().parse_args(arguments)
    # Imported late: `--help` answers before torch is loaded, and a command loads what it needs alone.
    module, _, name = chosen.run.partition(".")
    run = getattr(import_module(f"core.cli.{module}"), name)

    try:
        run(chosen)
    except (ValueError, OSError) as error:
        print(f"python -m core: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)


def parser() -> argparse.ArgumentParser:
    """The words of the command line."""
    top = _Parser(prog="python -m core", description="CodeNeRF without a window.", allow_abbrev=False)
    commands = top.add_subparsers(required=True, metavar="COMMAND")
    _add_render(commands)
    _add_turntable(commands)
    _add_mesh(commands)
    _add_fit(commands)
    _add_dataset(commands)
    _add_train(commands)
    _add_glance(commands)
    _add_convert(commands)
    _add_evaluate(commands)
    _add_bench(commands)
    return top


def _command(commands: argparse._SubParsersAction, name: str, run: str, about: str) -> argparse.ArgumentParser:
    command = commands.add_parser(name, help=about, description=about, formatter_class=_Formatter, allow_abbrev=False)
    command.set_defaults(run=run)
    return command


def _add_model(command: argparse.ArgumentParser) -> None:
    command.add_argument("--model", default="chairs", metavar="M", help="a shipped name or the path of a model file")
    _add_device(command)


def _add_device(command: argparse.ArgumentParser) -> None:
    command.add_argument("--device", choices=("cpu", "cuda"), default="cpu", help="where the network runs")


def _add_object_options(command: argparse.ArgumentParser) -> None:
    _add_model(command)
    what = command.add_mutually_exclusive_group()
    what.add_argument("--object", type=int, metavar="I", help="an object of the model, from 0; else the mean object")
    what.add_argument("--scene", type=Path, metavar="S.json", help="a saved scene, or a picture (png) that holds one")


def _add_scene_options(command: argparse.ArgumentParser) -> None:
    _add_object_options(command)
    command.add_argument(
        "--azimuth", type=_degrees, metavar="D", help="degrees; the front is seen from 90 (else 60, or the scene's)"
    )
    command.add_argument("--elevation", type=_degrees, metavar="D", help="degrees, -90 to 90 (else 20, or the scene's)")
    command.add_argument(
        "--distance",
        type=float,
        metavar="X",
        help="scene units (an object's diagonal is 1; else the model's, or the scene's)",
    )


def _add_render(commands: argparse._SubParsersAction) -> None:
    command = _command(commands, "render", "render.render", "draw one picture")
    _add_scene_options(command)
    command.add_argument("--size", type=_count, default=128, metavar="PX", help="width and height")
    command.add_argument("--exact", action="store_true", help="the slow reference renderer, 256 samples a ray")
    command.add_argument("--out", type=Path, required=True, metavar="X.png")


def _add_turntable(commands: argparse._SubParsersAction) -> None:
    command = _command(commands, "turntable", "render.turntable", "film one turn around an object")
    _add_scene_options(command)
    command.add_argument("--morph-to", type=int, metavar="J", help="become this object halfway round, and turn back")
    command.add_argument("--frames", type=_count, default=72, help="of the whole turn")
    command.add_argument("--fps", type=_count, default=24, help="frames per second")
    command.add_argument("--size", type=_count, default=256, metavar="PX", help="width and height")
    command.add_argument("--quality", type=_count, default=85, help="1 to 100")
    command.add_argument("--transparent", action="store_true", help="leave the white ground out (not in mp4)")
    command.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="X.mp4|.gif|.webp|.frames",
        help="a film; .frames: a folder of png pictures",
    )


def _add_mesh(commands: argparse._SubParsersAction) -> None:
    command = _command(commands, "mesh", "render.mesh", "write an object as a closed mesh with coloured vertices")
    _add_object_options(command)
    command.add_argument(
        "--resolution",
        type=_count,
        metavar="N",
        help="cells along the longest side (else as many as its detail asks)",
    )
    command.add_argument("--out", type=Path, required=True, metavar="X.glb|.ply|.obj")


def _add_fit(commands: argparse._SubParsersAction) -> None:
    command = _command(
        commands,
        "fit",
        "fit.fit",
        "find camera and codes of an object in pictures; ends with one JSON line",
    )
    command.add_argument("images", type=Path, nargs="+", metavar="IMAGE", help="pictures of one object")
    _add_model(command)
    command.add_argument(
        "--pose", type=Path, nargs="+", default=[], metavar="POSE.txt", help="known cameras (SRN files), one per image"
    )
    command.add_argument(
        "--box",
        type=_box,
        nargs="+",
        default=[],
        metavar="X0,Y0,X1,Y1",
        help="px around the object, one box per image: for a ground that is not plain",
    )
    _add_preset(command)
    command.add_argument(
        "--lens",
        action="store_true",
        help="search for the focal length too (told in heights of the picture); else it is the model's",
    )
    command.add_argument("--out", type=Path, metavar="S.json", help="where to save the fitted scene")
    command.add_argument("--log", type=Path, metavar="STEPS.jsonl", help="where to write every step, a line each")
    _add_seed(command)


def _add_seed(command: argparse.ArgumentParser) -> None:
    command.add_argument("--seed", type=int, default=0, help="of all that is drawn by lot")


def _add_preset(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--preset",
        choices=("draft", "normal", "fine", "paper"),
        default="normal",
        help="how much work; paper: the authors' recipe, one start",
    )


def _add_dataset(commands: argparse._SubParsersAction) -> None:
    kinds = commands.add_parser("dataset", help="render a dataset in ShapeNet-SRN's layout").add_subparsers(
        required=True, metavar="KIND"
    )
    meshes = _command(kinds, "meshes", "train.dataset_meshes", "render a folder of GLB files with its index.json")
    meshes.add_argument("folder", type=Path, metavar="DIR")
    meshes.add_argument("--variants", type=int, default=0, metavar="N", help="deformed, recoloured forms of each more")
    procedural = _command(kinds, "procedural", "train.dataset_procedural", "render objects of the built-in generator")
    procedural.add_argument("--count", type=_count, required=True, metavar="N", help="objects")
    swap = _command(kinds, "swap", "train.dataset_swap", "render trained and untrained pairs for evaluate --swap")
    swap.add_argument("--count", type=_count, required=True, metavar="N", help="objects of the table trained on")
    swap.add_argument("--blocks", type=_count, default=4, metavar="B", help="tables of four shapes x four textures")
    swap.add_argument("--views", type=_count, default=24, help="per object")
    for command in (meshes, procedural):
        command.add_argument("--split", choices=("train", "test"), default="train", help="what the objects are for")
        command.add_argument("--views", type=_count, help="per object (default: 50 to train on, 251 to test on)")
    for command in (meshes, procedural, swap):
        command.add_argument("--out", type=Path, required=True, metavar="DIR")
        command.add_argument("--size", type=_count, default=128, metavar="PX", help="width and height")
        command.add_argument("--category", choices=("cars", "chairs"), required=True)


def _add_train(commands: argparse._SubParsersAction) -> None:
    command = _command(commands, "train", "train.train", "train a category model; stop it and go on with --resume")
    command.add_argument("datasets", type=Path, nargs="+", metavar="DATASET", help="SRN folders")
    command.add_argument("--out", type=Path, required=True, metavar="M.safetensors")
    command.add_argument("--resume", action="store_true", help="go on from M.state, written beside M")
    command.add_argument(
        "--from", dest="begin", metavar="MODEL", help="start from a trained model, gently: more steps, or more objects"
    )
    command.add_argument("--steps", type=_count, default=100_000, help="of the whole schedule")
    command.add_argument(
        "--recipe",
        choices=("default", "paper", "M1", "M2"),
        default="default",
        help="M1, M2: ours, but entangled",
    )
    command.add_argument("--width", type=_count, help="of the network (default: the recipe's; ours: 96)")
    command.add_argument(
        "--latent",
        type=_count,
        nargs=2,
        metavar=("SHAPE", "TEXTURE"),
        help="numbers of a code (default: the recipe's; ours: 64 32)",
    )
    _add_device(command)
    _add_seed(command)


def _add_glance(commands: argparse._SubParsersAction) -> None:
    command = _command(
        commands, "glance", "train.glance", "teach a model where pictures are taken from, as train does in the end"
    )
    command.add_argument("datasets", type=Path, nargs="+", metavar="DATASET", help="SRN folders")
    _add_model(command)
    command.add_argument("--out", type=Path, required=True, metavar="M.safetensors")
    command.add_argument("--steps", type=_count, default=8000, help="of training")
    _add_seed(command)


def _add_convert(commands: argparse._SubParsersAction) -> None:
    command = _command(
        commands, "convert", "train.convert", "turn a checkpoint of the authors' trainer into a model file"
    )
    command.add_argument("checkpoint", type=Path, metavar="models.pth")
    command.add_argument("--config", type=Path, metavar="hpam.json", help="beside the checkpoint unless told")
    command.add_argument("--out", type=Path, required=True, metavar="X.safetensors")


def _add_evaluate(commands: argparse._SubParsersAction) -> None:
    command = _command(
        commands, "evaluate", "measure.evaluate", "the paper's protocol: fit a view, draw the others, compare"
    )
    command.add_argument("datasets", type=Path, nargs="+", metavar="DATASET", help="SRN folders of objects to test on")
    _add_model(command)
    command.add_argument("--swap", action="store_true", help="instead: codes of two objects for untrained pairs, leaks")
    command.add_argument("--inputs", type=_views, default="64", metavar="V,V", help="the views that are fitted")
    command.add_argument("--pose", choices=("known", "estimate"), default="known", help="the cameras of these views")
    _add_preset(command)
    command.add_argument("--objects", type=_count, metavar="N", help="only so many, spread over the dataset")
    command.add_argument("--every", type=_count, default=1, metavar="N", help="draw only each Nth of the other views")
    command.add_argument("--report", type=Path, metavar="R.json", help="numbers; a chart is put beside them as PNG")
    _add_seed(command)


def _add_bench(commands: argparse._SubParsersAction) -> None:
    kinds = commands.add_parser("bench", help="measure on this machine and draw the charts").add_subparsers(
        required=True, metavar="KIND"
    )
    rendering = _command(kinds, "render", "measure.bench_render", "milliseconds a frame against PSNR, part by part")
    rendering.add_argument("--views", type=_count, default=3, metavar="N", help="objects, each from another side")
    fitting = _command(kinds, "fit", "measure.bench_fit", "seconds against degrees of blind fits, preset by preset")
    parts = _command(kinds, "parts", "measure.bench_parts", "what every part of a blind fit is worth")
    for kind in (fitting, parts):
        kind.add_argument(
            "--dataset", type=Path, nargs="+", metavar="D", help="SRN folders; else the model's own objects"
        )
        kind.add_argument("--objects", type=_count, default=10, metavar="N", help="one view of each is fitted")
        _add_seed(kind)
    stability = _command(
        kinds, "stability", "measure.bench_stability", "where blind fits fail: success against stressors"
    )
    stability.add_argument("--objects", type=_count, default=2, metavar="N", help="of the model, spread over it")
    _add_seed(stability)
    size = _command(kinds, "size", "measure.bench_size", "what sizes of network and codes buy; trains a model for each")
    size.add_argument("datasets", type=Path, nargs="+", metavar="DATASET", help="SRN folders to train on")
    size.add_argument("--tests", type=Path, nargs="+", required=True, metavar="D", help="SRN folders of other objects")
    size.add_argument("--objects", type=_count, default=12, metavar="N", help="of these are fitted")
    size.add_argument("--steps", type=_count, default=3000, help="that each model is trained")
    size.add_argument("--models", type=Path, required=True, metavar="DIR", help="where they are kept, to go on later")
    for kind in (rendering, fitting, parts, stability):
        _add_model(kind)
    for kind in (rendering, fitting, parts, stability, size):
        kind.add_argument("--out", type=Path, default=Path("assets/charts"), metavar="DIR", help="where charts go")


def _views(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"views are whole numbers V,V, not {text!r}") from None


def _box(text: str) -> tuple[float, ...]:
    try:
        left, top, right, bottom = (float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"a box is four numbers X0,Y0,X1,Y1, not {text!r}") from None
    return left, top, right, bottom


def _degrees(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"an angle is a number of degrees, not {text!r}")
    return math.radians(value)


def _count(text: str) -> int:
    if not text.strip().isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, not {text!r}")
    return int(text)


if __name__ == "__main__":
    main()
