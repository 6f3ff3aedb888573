"""The command line. Imports no torch, so that ``--help`` answers at once. Options in degrees become radians."""

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from core.cli import argument_types as types
from core.fitting.settings import PRESETS
from core.lab.datasets.categories import SPLITS
from core.lab.training.recipes import RECIPES
from core.runtime.program import program_name

BENCHMARK_NAMES = ("fits", "stability", "frames", "exports", "disentanglement")


class _Formatter(argparse.ArgumentDefaultsHelpFormatter):
    """Shows the defaults of options that their help does not tell, except None, False and empty ones."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        has_default = action.default not in (None, [], ()) and action.default is not False
        is_told = "(default: " in (action.help or "")
        return super()._get_help_string(action) if has_default and not is_told else action.help


class _Parser(argparse.ArgumentParser):
    """Reports errors in one line."""

    def error(self, message: str) -> NoReturn:
        """Print the message and exit with status 2."""
        print(f"{self.prog}: {message}", file=sys.stderr)
        sys.exit(2)


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Parse one command; ``run`` of the result names the function to execute, as ``module.function`` of core.cli.

    Exits with status 2 and one line on stderr for wrong arguments.
    """
    return build_parser().parse_args(arguments)


def build_parser() -> argparse.ArgumentParser:
    """Build the parser of all commands."""
    top = _Parser(prog=program_name("core", "codenerf"), description="CodeNeRF without a window.", allow_abbrev=False)
    commands = top.add_subparsers(required=True, metavar="COMMAND")
    library = _add_render, _add_turntable, _add_mesh, _add_page, _add_fit
    training = _add_dataset, _add_train, _add_train_viewpoint, _add_train_parts, _add_convert
    for add in (*library, *training, _add_evaluate, _add_bench):
        add(commands)
    return top


# Options of several commands


def _add_command(commands: argparse._SubParsersAction, name: str, run: str, text: str) -> argparse.ArgumentParser:
    """Add a command that runs the function ``run``, given as ``module.function`` of core.cli."""
    command = commands.add_parser(name, help=text, description=text, formatter_class=_Formatter, allow_abbrev=False)
    command.set_defaults(run=run)
    threads = "threads that compute (default: $CODENERF_THREADS, else one for each core)"
    option(command, "--threads", types.whole_from(1, 1024), "N", threads)
    return command


def option(
    group: argparse._ActionsContainer, name: str, kind: Callable[[str], Any], value: str, text: str, **more: Any
) -> None:
    """Add an option or argument whose values ``kind`` parses; the help shows ``value`` and ``text``.

    One with several values may be repeated. ``more`` is for :meth:`argparse.ArgumentParser.add_argument`.
    """
    action = "extend" if "nargs" in more else "store"
    group.add_argument(name, type=kind, metavar=value, help=text, **{"action": action, **more})


def _add_model(command: argparse.ArgumentParser) -> None:
    option(command, "--model", types.model_name, "M", "a shipped name or the path of a model file", default="chairs")
    _add_device(command)


def _add_device(command: argparse.ArgumentParser) -> None:
    command.add_argument("--device", choices=("cpu", "cuda"), default="cpu", help="where the network runs")


def _add_pose_scale(command: argparse.ArgumentParser) -> None:
    scale = "scene units of a unit of the pose files; an object's diagonal is 1 scene unit"
    option(command, "--pose-scale", types.number_from(1e-6, 1e6), "X", scale, default=1.0)


def _add_seed(command: argparse.ArgumentParser) -> None:
    command.add_argument("--seed", type=types.whole_from(0, 2**32 - 1), default=0, help="random seed")


def _add_out(command: argparse.ArgumentParser, names: str, description: str = "") -> None:
    option(command, "--out", Path, names, description, required=True)


def _add_object_options(command: argparse.ArgumentParser) -> None:
    _add_model(command)
    what = command.add_mutually_exclusive_group()
    option(what, "--object", int, "I", "an object of the model, from 0; else the mean object")
    scene = "a saved scene, or an image (png) that embeds one"
    option(what, "--scene", types.input_file, "S.json", scene)
    plain = "show the colours of the codes alone, without the photo detail of a fitted scene"
    command.add_argument("--no-photo-detail", action="store_true", help=plain)
    edit = "move along named directions by standard deviations: rounder=1.5,darker=-1"
    option(command, "--edit", types.edits, "NAME=X,…", edit, action="extend", default=[])
    paint = "colour a part, such as the fabric or wood of a chair (default: the largest); photo detail stays"
    option(command, "--paint", types.paints, "[PART=]#rrggbb,…", paint, action="extend", default=[])
    size = "stretch the object to this width, depth and height in centimetres: 60x58x92 (default: as it is)"
    option(command, "--size-cm", types.size_cm, "WxDxH", size)
    for name, extent in (("legs", "of a chair, up to its seat"), ("roof", "of a car, from its windows up")):
        portion = f"the {name} {extent}; the rest keeps its height, or with --size-cm the whole does"
        option(command, f"--{name}-cm", types.portion_cm(name), "CM", portion, dest="portion_cm")


def _add_scene_options(command: argparse.ArgumentParser) -> None:
    _add_object_options(command)
    option(command, "--azimuth", types.degrees_up_to(3600), "D", "degrees; 90: the front (default: 60 or scene's)")
    option(command, "--elevation", types.degrees_up_to(90), "D", "degrees, -90 to 90 (default: 20 or scene's)")
    distance = "scene units; an object's diagonal is 1 (default: fill the frame, but the scene's for an image)"
    option(command, "--distance", types.number_from(0.05, 100, " scene units"), "X", distance)


def _add_dimensions(command: argparse.ArgumentParser, placement: str) -> None:
    text = f"draw width, depth and height as in a furniture catalogue, {placement}"
    command.add_argument("--dimensions", choices=("cm", "in"), help=text)


def _add_variants(command: argparse.ArgumentParser, text: str) -> None:
    option(command, "--variants", types.input_file, "S.json", text, nargs="+", default=[])


def _add_render(commands: argparse._SubParsersAction) -> None:
    command = _add_command(commands, "render", "render.render", "render one image")
    _add_scene_options(command)
    option(command, "--size", types.image_size, "PX|WxH", "(default: 128)", default=(128, 128))
    command.add_argument("--exact", action="store_true", help="the slow reference renderer, 256 samples a ray")
    _add_dimensions(command, "with room for them around the object")
    _add_out(command, "X.png")


def _add_turntable(commands: argparse._SubParsersAction) -> None:
    command = _add_command(commands, "turntable", "render.turntable", "write a video around an object")
    _add_scene_options(command)
    films = command.add_mutually_exclusive_group()
    films.add_argument("--swing", action="store_true", help="70 degrees to both sides instead of all round")
    partner = "morph into the object of a scene, or this one of the model, and back (takes a minute)"
    option(films, "--to", types.object_or_scene, "S.json|J", partner)
    frames = "number of frames (default: 72, of a swing 96)"
    option(command, "--frames", types.whole_from(1, 100_000), "N", frames)
    option(command, "--fps", types.whole_from(1, 100), "N", "frames per second", default=24)
    option(command, "--size", types.image_size, "PX|WxH", "(default: 512)", default=(512, 512))
    option(command, "--quality", types.whole_from(1, 100), "N", "1 to 100 (gif: colours)", default=85)
    command.add_argument("--transparent", action="store_true", help="transparent background (not in mp4)")
    command.add_argument("--shadow", action="store_true", help="the object's shadow on the ground (no transparent gif)")
    exact = "render every frame with the network, which takes minutes; other frames match these to 45 dB or better"
    command.add_argument("--exact", action="store_true", help=exact)
    _add_dimensions(command, "on the last frame, which then stays for two seconds")
    _add_out(command, "X.mp4|.gif|.webp|.frames", "a video; .frames: a folder of png images")


def _add_mesh(commands: argparse._SubParsersAction) -> None:
    command = _add_command(commands, "mesh", "render.mesh", "write an object as a coloured mesh, its parts named")
    _add_object_options(command)
    resolution = "cells along the longest side (default: as many as the object's detail needs)"
    option(command, "--resolution", types.count, "N", resolution)
    texture = "glb, usdz: width of a colour image, approximately (default: colours at the vertices; of a usdz 1024)"
    option(command, "--texture", types.count, "PX", texture)
    option(command, "--triangles", types.count, "N", "at most (default: all; 8,000 with a texture)")
    metres = "longest side, on the ground (default: --size-cm, else usual for the model)"
    option(command, "--metres", types.number_from(1e-4, 1e6), "M", metres)
    _add_variants(command, "glb: scenes of the same shape; their colours are variants by the names of their files")
    _add_out(command, "X.glb|.usdz|.ply|.obj|.stl|.3mf")


def _add_page(commands: argparse._SubParsersAction) -> None:
    command = _add_command(commands, "page", "render.page", "write a web page in which an object turns, in one file")
    _add_scene_options(command)
    command.add_argument("--name", metavar="TEXT", help="the object's name (default: the scene file's)")
    _add_variants(command, "scenes of the same shape; each is a swatch by the name of its file")
    _add_dimensions(command, "with a switch")
    ar = "for phones: holds a usdz for iPhones; writes X.room.glb beside it for Android, where both are on a web server"
    command.add_argument("--ar", action="store_true", help=ar)
    _add_out(command, "X.html")


def _add_fit(commands: argparse._SubParsersAction) -> None:
    command = _add_command(commands, "fit", "fit.fit", "estimate camera and codes of an object in images; prints JSON")
    images = (
        "up to 12 images of one object, a folder of them, or a video; back:chair.jpg (front, left, back, right, above) "
        "names the side that an image shows; see --each"
    )
    option(command, "images", types.input_file, "[SIDE:]IMAGE", images, nargs="+")
    command.set_defaults(sides=())
    _add_each(command)
    resume = "fitted scene, whose object finds the cameras of these further images of it: a quarter of a search's time"
    option(command, "--resume", types.input_file, "S.json", resume)
    models = "shipped name or path (default: by the first image's category)"
    option(command, "--model", types.model_name, "M", models)
    _add_device(command)
    frames = "frames of a video: the sharpest at even steps of time (default: 8)"
    option(command, "--frames", types.whole_from(1, 12), "N", frames)
    pose = "known cameras: an SRN file for each image, or one transforms.json with the images' names"
    option(command, "--pose", types.input_file, "POSE", pose, nargs="+", default=[])
    axes = "camera axes of SRN files; opengl: Blender's"
    command.add_argument("--pose-axes", choices=("opencv", "opengl"), default="opencv", help=axes)
    _add_pose_scale(command)
    _add_hints(command)
    _add_preset(command)
    command.add_argument("--estimate-focal", action="store_true", help="find the focal length too (default: model's)")
    plain = "do not save the photo, whose details such as lettering are added to images"
    command.add_argument("--no-photo-detail", action="store_true", help=plain)
    option(command, "--out", Path, "S.json", "write the fitted scene (--each: a folder)")
    option(command, "--log", Path, "STEPS.jsonl", "write every step to this file, one line each")
    page = "write a page of detections, cut-out, witnesses and results"
    option(command, "--explain", Path, "DIR", page)
    _add_seed(command)


def _add_each(command: argparse.ArgumentParser) -> None:
    help_text = (
        "each image, or folder of images, shows an object of its own: fit them into the folder --out, as many at once "
        "as --threads, each in a process of about 0.7 GB; started again, fits only what is missing"
    )
    run: dict[str, Any] = {
        "dest": "run",
        "action": "store_const",
        "const": "fit_each.fit_each",
        "default": argparse.SUPPRESS,
    }
    command.add_argument("--each", help=help_text, **run)
    cluster = "with --each: fit on this Dask cluster, which sees the same files"
    option(command, "--cluster", str, "tcp://HOST:PORT", cluster)


def _add_hints(command: argparse.ArgumentParser) -> None:
    hints = command.add_mutually_exclusive_group()
    kinds = (
        ("--point", types.point, "X,Y", "px on each image's object"),
        ("--mask", types.input_file, "MASK", "one per image, white on it"),
        ("--box", types.box, "X0,Y0,X1,Y1", "px around the object, one box per image: for several objects or clutter"),
        ("--object", types.count, "N", "the N-th detection per image"),
    )
    for name, kind, text, description in kinds:
        option(hints, name, kind, text, description, nargs="+", default=[])


def _add_preset(command: argparse.ArgumentParser) -> None:
    preset = "how much work; paper: the authors' method, from one initialisation"
    command.add_argument("--preset", choices=tuple(PRESETS), default="normal", help=preset)


def _add_dataset(commands: argparse._SubParsersAction) -> None:
    parser = commands.add_parser("dataset", help="render a dataset in ShapeNet-SRN's layout")
    kinds = parser.add_subparsers(required=True, metavar="KIND")
    meshes = _add_command(kinds, "meshes", "train.dataset_meshes", "render a folder of GLB files with its index.json")
    meshes.add_argument("folder", type=Path, metavar="DIR")
    option(meshes, "--variants", types.whole_from(0, 10_000), "N", "deformed, recoloured variants of each", default=0)
    meshes.add_argument("--split", choices=SPLITS, default="train", help="split that the objects belong to")
    option(meshes, "--views", types.whole_from(1, 10_000), "VIEWS", "per object (default: 50 to train on, else 251)")
    _add_out(meshes, "DIR")
    option(meshes, "--size", types.whole_from(8, 4096), "PX", "width and height", default=128)
    meshes.add_argument("--category", required=True, metavar="NAME", help="in the plural: chairs, cars, boats")
    pack = _add_command(kinds, "pack", "train.dataset_pack", "write datasets into one small file, read like a folder")
    pack.add_argument("folders", type=Path, nargs="+", metavar="DATASET")
    _add_out(pack, "X.views")
    option(pack, "--size", types.whole_from(8, 4096), "PX", "reduce larger images to this")
    option(pack, "--quality", types.whole_from(1, 100), "N", "of the colours; 100: exact", default=60)


_DEFAULT = RECIPES["default"]


def _add_train(commands: argparse._SubParsersAction) -> None:
    shared_out = "on N cards or processors, with the objects shared out: torchrun --nproc-per-node N -m core train ..."
    text = f"train a category model; --resume continues a run; {shared_out}"
    command = _add_command(commands, "train", "train.train", text)
    option(command, "datasets", Path, "DATASET", "folders in the layout of SRN or NeRF", nargs="+")
    shares = "fraction of the rays for each dataset"
    command.add_argument("--shares", type=types.number_from(1e-6, 1e6), nargs="+", default=(), help=shares)
    _add_out(command, "M.safetensors")
    command.add_argument("--resume", action="store_true", help="continue from M.state, written beside M")
    rates = "learning rates are a twentieth, or half if the datasets contain new objects"
    initial = f"start from a trained model and keep its viewpoint classifier; {rates}"
    option(command, "--init", str, "MODEL", initial)
    command.add_argument("--steps", type=types.count, default=100_000, help="length of the schedule")
    rays = f"per step (default: {_DEFAULT.rays}; 32768 on a card)"
    option(command, "--rays", types.whole_from(1, 1_000_000), "RAYS", rays)
    command.add_argument("--recipe", choices=tuple(RECIPES), default="default", help="M1, M2: the entangled ablations")
    field = _DEFAULT.field
    option(command, "--width", types.whole_from(1, 8192), "WIDTH", f"of the network ({field.width}, or the recipe's)")
    latent = f"dimensions of a code (default: the recipe's; {field.shape_latent} {field.texture_latent} by default)"
    codes = ("SHAPE", "TEXTURE")
    command.add_argument("--latent", type=types.whole_from(1, 8192), nargs=2, metavar=codes, help=latent)
    _add_device(command)
    _add_pose_scale(command)
    _add_seed(command)


def _add_train_viewpoint(commands: argparse._SubParsersAction) -> None:
    text = "train a model's viewpoint classifier, as train does last"
    command = _add_command(commands, "train-viewpoint", "train.train_viewpoint_classifier", text)
    option(command, "datasets", Path, "DATASET", "folders in the layout of SRN or NeRF", nargs="+")
    _add_model(command)
    _add_out(command, "M.safetensors")
    command.add_argument("--steps", type=types.count, default=8000, help="of training")
    _add_pose_scale(command)
    _add_seed(command)


def _add_train_parts(commands: argparse._SubParsersAction) -> None:
    text = "train a model's part head, which labels the parts of meshes"
    command = _add_command(commands, "train-parts", "train.train_part_head", text)
    _add_model(command)
    _add_out(command, "M.safetensors")
    labels = "a model with a part head, trained on some of the same objects"
    option(command, "--labels", str, "MODEL", labels, required=True)
    option(command, "--objects", types.count, "N", "common objects to use", default=200)


def _add_convert(commands: argparse._SubParsersAction) -> None:
    command = _add_command(commands, "convert", "train.convert", "turn a checkpoint of the authors into a model file")
    command.add_argument("checkpoint", type=Path, metavar="models.pth")
    option(command, "--config", Path, "hpam.json", "default: beside the checkpoint")
    _add_out(command, "X.safetensors")


def _add_evaluate(commands: argparse._SubParsersAction) -> None:
    command = _add_command(commands, "evaluate", "evaluate.evaluate", "the paper's protocol: fit a view, score others")
    option(command, "datasets", Path, "DATASET", "folders of objects to test on", nargs="+")
    _add_model(command)
    option(command, "--input-views", types.view_numbers, "V,V", "the fitted views", default="64")
    command.add_argument("--pose", choices=("known", "estimate"), default="known", help="cameras of the input views")
    _add_preset(command)
    option(command, "--objects", types.count, "N", "at most so many, evenly spaced over the dataset")
    option(command, "--view-stride", types.count, "N", "render every Nth other view only", default=1)
    option(command, "--report", Path, "R.json", "write the scores")
    _add_pose_scale(command)
    _add_seed(command)


def _add_bench(commands: argparse._SubParsersAction) -> None:
    parser = commands.add_parser("bench", help="measure on this machine and plot charts")
    kinds = parser.add_subparsers(required=True, metavar="KIND")
    for name, (help_text, *option_adders) in _KINDS.items():
        kind = _add_command(kinds, name, f"measure.bench_{name}", help_text)
        for add in option_adders:
            add(kind)
        option(kind, "--out", Path, "DIR", "folder of the charts", default=Path("assets/charts"))


def _add_all(kind: argparse.ArgumentParser) -> None:
    kind.add_argument("--quick", action="store_true", help="a few cases and objects in five minutes")
    option(kind, "--minutes", types.number_from(0, 1e5), "M", "when to stop (default: when all is done)")
    option(kind, "--dataset", Path, "D", "held-out objects (default: assets/benchmark)", nargs="+")
    option(kind, "--objects", types.count, "N", "of each dataset (default: all; quickly two)")
    option(kind, "--views", types.count, "N", "fitted views of each object, one after another", default=1)
    text = f"some of {', '.join(BENCHMARK_NAMES)}"
    kind.add_argument("--only", choices=BENCHMARK_NAMES, nargs="+", metavar="NAME", help=text)


def _add_write(kind: argparse.ArgumentParser) -> None:
    kind.add_argument("--write", action="store_true", help="write gate.csv, the baseline, instead")


_KINDS: dict[str, tuple[str, *tuple[Callable[[argparse.ArgumentParser], object], ...]]] = {
    "all": ("measure everything on the page of charts, row by row, and draw it; resumable", _add_all),
    "page": ("draw the charts and fill the page again from the CSV files",),
    "gate": ("fail if anything takes twice as long as in gate.csv", _add_write),
}  # help text of each kind, and functions that add its options
