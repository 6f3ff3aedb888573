"""What the commands do: each reads the parsed words of :mod:`core.__main__` and drives a stream to its end."""

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import replace
from itertools import chain, pairwise
from pathlib import Path
from typing import TypeVar

import torch
from tqdm import tqdm

from core.authors import load_authors
from core.bench import charts, fitting, rendering, sizes, stability
from core.bench.subjects import dataset_subjects, own_subjects
from core.camera import Camera
from core.codes import Codes
from core.confidence import DOUBTFUL
from core.cutout import Hints, NoGroundError
from core.data.meshes import mesh_plan, render_meshes
from core.data.procedural import procedural_plan, render_procedural, swap_plan
from core.data.variants import cells
from core.data.views import SPIRAL_VIEWS
from core.dataset import ObjectPlace, find_objects, read_dataset
from core.evaluate import ObjectScore, Protocol
from core.evaluate import evaluate as scored
from core.fit import PRESETS, Alternative, FitJob, FitStep, fit
from core.frames import picture
from core.library import load_model
from core.mesh import export_mesh
from core.model import Model
from core.photos import load_photo
from core.pictures import open_scene, save_picture
from core.reading import upright_size
from core.render import render_exact
from core.report import swap_told, told, write_report, write_swap_report
from core.scene import Scene
from core.swap import CellScore, swap, table
from core.timeline import Key, Shot, Timeline, turntable
from core.train import RECIPES, Trainer, held_out_psnr, hold_out
from core.video import VideoSettings, film

_MEASURED_EVERY = 5000
"""Steps between two measurements of a model in training, which is saved at the same time."""
_Score = TypeVar("_Score", ObjectScore, CellScore)
_Thing = TypeVar("_Thing")
_Found = TypeVar("_Found")
_VIEWS = {"train": 50, "test": SPIRAL_VIEWS}


def render(chosen: argparse.Namespace) -> None:
    """``render``: one picture."""
    model, codes, camera = _viewed(chosen)
    _require_folder(chosen.out)
    camera = camera.resized(chosen.size, chosen.size)
    if chosen.exact:
        colour = render_exact(model, codes, camera).colour.clamp(0, 1)
        image = (colour * 255 + 0.5).byte().cpu().numpy()
    else:
        image = picture(model, codes, camera).image
    save_picture(image, chosen.out, Scene(model.fingerprint, codes, camera))


def turntable_command(chosen: argparse.Namespace) -> None:
    """``turntable``: a video of one turn, into another object and back if told."""
    model, codes, camera = _viewed(chosen)
    settings = VideoSettings(chosen.size, chosen.fps, chosen.quality, chosen.transparent)
    shots = turntable(codes, camera, chosen.frames)
    if chosen.morph_to is not None:
        there, length = Shot(model.codes[chosen.morph_to], camera), chosen.frames / chosen.fps
        keys = Key(0.0, Shot(codes, camera)), Key(length / 2, there)
        shots = Timeline(keys, length, turns=1).shots(chosen.fps)
    written = film(model, shots, chosen.out, settings)
    _drive((count for before, count in pairwise(chain((0,), written)) if count > before), len(shots), "frame")


def mesh(chosen: argparse.Namespace) -> None:
    """``mesh``: an object as triangles."""
    model, codes, _ = _chosen(chosen)
    shares = export_mesh(model, codes, chosen.out, chosen.resolution)
    with tqdm(total=1.0, bar_format="{percentage:3.0f} %|{bar}| {elapsed}", leave=False, disable=None) as bar:
        for share in shares:
            bar.update(share - bar.n)


def fit_command(chosen: argparse.Namespace) -> None:
    """``fit``: camera and codes of the object in the pictures; the last line on stdout is the result as JSON."""
    if chosen.pose and len(chosen.pose) != len(chosen.images):
        raise ValueError(f"{len(chosen.images)} images need as many poses, got {len(chosen.pose)}")
    if chosen.box and len(chosen.box) != len(chosen.images):
        raise ValueError(f"{len(chosen.images)} images need as many boxes, got {len(chosen.box)}")
    model = load_model(chosen.model)
    poses = chosen.pose or [None] * len(chosen.images)
    hints = map(_boxed, chosen.images, chosen.box or [None] * len(chosen.images))
    each = zip(chosen.images, poses, hints, strict=True)
    try:
        photos = tuple(load_photo(image, model, pose, hint) for image, pose, hint in each)
    except NoGroundError as error:
        raise ValueError(f"{error}; a box is told by --box X0,Y0,X1,Y1") from None
    for path in filter(None, (chosen.out, chosen.log)):
        _require_folder(path)
    last, bar = None, tqdm(unit="step", leave=False, disable=None)
    with bar, chosen.log.open("w") if chosen.log else nullcontext() as log:
        for last in fit(model, FitJob(photos, PRESETS[chosen.preset], chosen.seed)):
            bar.total = last.steps
            bar.set_postfix_str(f"{last.psnr:.2f} dB")
            bar.update()
            if log:
                log.write(json.dumps(_told(last) | {"start": last.start}) + "\n")
    if last is None:
        raise ValueError("the fit made no step")
    if chosen.out:
        Scene(model.fingerprint, last.codes, last.cameras[0]).save(chosen.out)
    if last.alternative and last.confidence is not None and last.confidence < DOUBTFUL:
        print(f"python -m core: {_doubt(last.confidence, last.alternative)}", file=sys.stderr)
    print(json.dumps(_told(last)), flush=True)


def _boxed(image: Path, box: tuple[float, ...] | None) -> Hints | None:
    """A box in px of the upright picture."""
    if box is None:
        return None
    width, height = upright_size(image)
    left, top, right, bottom = box
    try:
        return Hints((left / width, top / height, right / width, bottom / height))
    except ValueError as error:
        raise ValueError(f"{image}: {error} of {width}x{height} px") from None


def dataset_meshes(chosen: argparse.Namespace) -> None:
    """``dataset meshes``: GLB files rendered into SRN folders."""
    plan = mesh_plan(chosen.folder, chosen.category, chosen.split)
    views = chosen.views or _VIEWS[chosen.split]
    where = chosen.folder, chosen.out, chosen.category, chosen.split
    made = render_meshes(*where, views, chosen.size, chosen.variants)
    _drive(made, len(plan) * len(cells(chosen.variants)), "object")


def dataset_procedural(chosen: argparse.Namespace) -> None:
    """``dataset procedural``: generated objects rendered into SRN folders."""
    plan = procedural_plan(chosen.category, chosen.count, chosen.split)
    views = chosen.views or _VIEWS[chosen.split]
    made = render_procedural(plan, chosen.category, chosen.out, chosen.split, views, chosen.size)
    _drive(made, len(plan), "object")


def dataset_swap(chosen: argparse.Namespace) -> None:
    """``dataset swap``: trained and untrained pairs of procedural shapes and textures, for ``evaluate --swap``."""
    plan = swap_plan(chosen.category, chosen.count, chosen.blocks)
    made = render_procedural(plan, chosen.category, chosen.out, "test", chosen.views, chosen.size)
    _drive(made, len(plan), "object")


def train(chosen: argparse.Namespace) -> None:
    """``train``: a model from datasets, saved with its state as it goes."""
    _require_folder(chosen.out)
    recipe = RECIPES[chosen.recipe]
    sizes = {"width": chosen.width} if chosen.width else {}
    if chosen.latent:
        sizes |= dict(zip(("shape_latent", "texture_latent"), chosen.latent, strict=True))
    settings = replace(recipe, field=replace(recipe.field, **sizes), steps=chosen.steps, seed=chosen.seed)
    training, held_out = hold_out(read_dataset(chosen.datasets))
    trainer = Trainer(training, settings, chosen.device)
    state = chosen.out.with_suffix(".state")
    if chosen.resume:
        trainer.load_state(state)
    with tqdm(total=chosen.steps, initial=trainer.step, unit="step", smoothing=0.01, disable=None) as bar:
        for step in trainer.steps():
            bar.update()
            if step.step % 100 == 0:
                bar.set_postfix_str(f"rays {step.psnr:.2f} dB")
            if step.step % _MEASURED_EVERY == 0 or step.step == step.steps:
                model = trainer.model()
                model.save(chosen.out)
                trainer.save_state(state)
                found = held_out_psnr(model, held_out)
                tqdm.write(f"step {step.step}: {found:.2f} dB on views not trained on, {step.seconds:.0f} s")


def convert(chosen: argparse.Namespace) -> None:
    """``convert``: a checkpoint of the authors' trainer as a model file."""
    _require_folder(chosen.out)
    if chosen.out.suffix != ".safetensors":
        raise ValueError(f"{chosen.out.name}: a model file is called .safetensors")
    model = load_authors(chosen.checkpoint, chosen.config)
    model.save(chosen.out)
    lost = ", ".join(str(index) for index in sorted(model.codes.broken))
    print(
        f"{len(model.codes)} {model.category}" + (f"; next to empty, so left out of the mean: {lost}" if lost else "")
    )


def evaluate(chosen: argparse.Namespace) -> None:
    """``evaluate``: the paper's table on a test set, or with ``--swap`` how well shape and texture are told apart."""
    protocol = Protocol(chosen.inputs, chosen.pose == "estimate", chosen.preset, chosen.seed)
    if chosen.swap and protocol != Protocol(seed=chosen.seed):
        raise ValueError("--swap draws cells with their true cameras: it goes with no --inputs, --pose or --preset")
    model = load_model(chosen.model)
    places = _places(model, chosen.datasets)
    if chosen.report:
        _require_folder(chosen.report)
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
    found = _watched(rendering.measured(load_model(chosen.model), chosen.views))
    charts.write_rendering(found, chosen.out)
    print(charts.rendering_table(found), flush=True)


def bench_fit(chosen: argparse.Namespace) -> None:
    """``bench fit``: speed and accuracy of blind fits, as numbers, table and chart."""
    charts.prepare(chosen.out)
    model = load_model(chosen.model)
    generator = torch.Generator().manual_seed(chosen.seed)
    if chosen.dataset:
        places = _spread(_places(model, [chosen.dataset]), chosen.objects)
        seen = dataset_subjects(places, generator)
    else:
        seen = own_subjects(model, chosen.objects, generator)
    found = _watched(fitting.measured(model, tuple(seen)))
    charts.write_fitting(found, chosen.out)
    print(charts.fitting_table(found), flush=True)


def bench_stability(chosen: argparse.Namespace) -> None:
    """``bench stability``: the atlas of where fits fail, as numbers, table and chart."""
    charts.prepare(chosen.out)
    found = _watched(stability.measured(load_model(chosen.model), chosen.objects, chosen.seed))
    charts.write_stability(found, chosen.out)
    print(charts.stability_table(found), flush=True)


def bench_size(chosen: argparse.Namespace) -> None:
    """``bench size``: what sizes of network and codes buy, as numbers, table and chart."""
    charts.prepare(chosen.out)
    _require_folder(chosen.models / "any")
    _, tests = find_objects(chosen.tests)
    dataset, tests = read_dataset(chosen.datasets), _spread(tests, chosen.objects)
    found = _watched(sizes.measured(dataset, tests, chosen.steps, chosen.models))
    charts.write_sizes(found, chosen.out)
    print(charts.sizes_table(found), flush=True)


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


def _viewed(chosen: argparse.Namespace) -> tuple[Model, Codes, Camera]:
    """The model, codes and camera that the options name: a scene's or an object's, seen from the front unless told."""
    model, codes, camera = _chosen(chosen)
    told = {name: getattr(chosen, name) for name in ("azimuth", "elevation", "distance")}
    return model, codes, replace(camera, **{name: value for name, value in told.items() if value is not None})


def _chosen(chosen: argparse.Namespace) -> tuple[Model, Codes, Camera]:
    """The model and the codes that the options name, with the scene's own camera or one from the front."""
    model = load_model(chosen.model)
    if chosen.scene:
        scene = open_scene(chosen.scene, model)
        return model, scene.codes, scene.camera
    codes = model.codes.mean if chosen.object is None else model.codes[chosen.object]
    return model, codes, model.camera(math.radians(60), math.radians(20))


def _told(step: FitStep) -> dict[str, object]:
    other = step.alternative
    return {
        **_camera_told(step.cameras[0]),
        "psnr": round(step.psnr, 3),
        "seconds": round(step.seconds, 3),
        "steps": step.step,
        "loss": step.loss,
        "confidence": step.confidence and round(step.confidence, 3),
        "alternative": other and {**_camera_told(other.cameras[0]), "loss": other.loss},
    }


def _camera_told(camera: Camera) -> dict[str, float]:
    return {
        "azimuth": round(math.degrees(camera.azimuth), 4),
        "elevation": round(math.degrees(camera.elevation), 4),
        "distance": round(camera.distance, 5),
    }


def _doubt(trust: float, other: Alternative) -> str:
    told = _camera_told(other.cameras[0])
    where = f"azimuth {told['azimuth']:.0f}, elevation {told['elevation']:.0f}"
    return f"the camera is doubtful (confidence {trust:.2f}); {where} explains the picture nearly as well"


def _drive(stream: Iterator[object], total: int, unit: str) -> None:
    """Run a stream to its end under a progress bar, which appears once the first value is there and all is well."""
    next(stream, None)
    with tqdm(total=total, unit=unit, initial=1, disable=None) as bar:
        for _ in stream:
            bar.update()


def _require_folder(path: Path) -> None:
    if not path.absolute().parent.is_dir():
        raise ValueError(f"cannot write {path}: there is no folder {path.parent}")
