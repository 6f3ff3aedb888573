"""Commands that make data and models: ``dataset``, ``train``, ``train-viewpoint``, ``train-parts``, ``convert``."""

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import torch
from tqdm import tqdm

from core.classifiers.viewpoint import ViewpointClassifier
from core.cli.progress import run_with_progress, wait_for_view_bank
from core.editing.words import direction_words
from core.lab.datasets.glb_objects import mesh_tasks, render_objects
from core.lab.datasets.packs import SUFFIX
from core.lab.datasets.srn import Dataset, index_objects, pack_datasets, read_dataset
from core.lab.datasets.srn_cameras import SPIRAL_VIEWS
from core.lab.training.held_out import CurvePoint, held_out_psnr, hold_out, read_curve, write_curve
from core.lab.training.parts import fit_part_head, labelled_places
from core.lab.training.processes import Processes, training_processes
from core.lab.training.recipes import RECIPES
from core.lab.training.trainer import Trainer
from core.lab.training.viewpoint import accuracy_within, train_viewpoint, viewpoint_dataset
from core.models.authors_checkpoint import load_authors
from core.models.library import load_model
from core.models.model import Model
from core.photos.view_bank import view_bank
from core.runtime.files import require_writable

_CHECKPOINT_EVERY = 5000  # steps between two checkpoints, each measured on held-out views
_VIEWPOINT_FRACTION = 12  # steps of the model per step of the viewpoint classifier
_VALIDATION_STRIDE = 20  # every 20th object is held out to measure a classifier
_VALIDATION_ANGLE = math.radians(15)  # largest error of a correct predicted direction
_Object = TypeVar("_Object")
_DEFAULT_VIEWS = {"train": 50, "validation": SPIRAL_VIEWS, "test": SPIRAL_VIEWS}


def dataset_meshes(args: argparse.Namespace) -> None:
    """Run ``dataset meshes``: render GLB files into SRN folders."""
    tasks = mesh_tasks(args.folder, args.category, args.split, args.variants)
    views = args.views or _DEFAULT_VIEWS[args.split]
    rendered = render_objects(tasks, args.out, args.category, args.split, views, args.size)
    run_with_progress(rendered, len(tasks), "object")


def dataset_pack(args: argparse.Namespace) -> None:
    """Run ``dataset pack``: write dataset folders into one file."""
    if args.out.suffix != SUFFIX:
        raise ValueError(f"{args.out.name}: a pack of views must end in {SUFFIX}")
    require_writable(args.out)
    _, entries = index_objects(args.folders)
    packed = pack_datasets(args.folders, args.out, args.size, args.quality)
    run_with_progress(packed, len(entries), "object")


def train(args: argparse.Namespace) -> None:
    """Run ``train``: train a model on datasets, regularly saving it, its state and its curve."""
    require_writable(args.out)
    initial = load_model(args.init) if args.init else None
    with training_processes(args.device) as processes:
        if processes.rank > 0:  # neither writes nor prints, and keeps no images
            for _ in _start_training(args, initial, processes)[0].steps():
                pass
            return
        trainer, training, held_out = _start_training(args, initial, processes)
        _train_and_save(args, trainer, held_out)
    model = trainer.model()
    if initial and initial.viewpoint_classifier:
        model = replace(model, viewpoint_classifier=initial.viewpoint_classifier)
    elif args.recipe == "default":
        steps = max(1, args.steps // _VIEWPOINT_FRACTION)
        model = _with_viewpoint(model, training, steps, args.seed)
    _save_complete(model, args.out)


def _start_training(
    args: argparse.Namespace, initial: Model | None, processes: Processes
) -> tuple[Trainer, Dataset, Dataset]:
    """Return the trainer, resumed if so chosen, and the datasets to train on and to measure on."""
    recipe = RECIPES[args.recipe]
    rays = args.rays or recipe.rays
    field = recipe.field
    if initial:
        if args.width or args.latent or args.recipe != "default":
            raise ValueError("--init keeps its model's sizes and architecture: omit --width, --latent and --recipe")
        field = initial.field.config
    shape, texture = args.latent or (field.shape_latent, field.texture_latent)
    field = replace(field, width=args.width or field.width, shape_latent=shape, texture_latent=texture)
    settings = replace(recipe, field=field, steps=args.steps, rays=rays, seed=args.seed)
    training, held_out = hold_out(read_dataset(args.datasets, args.shares, args.pose_scale))
    if initial:
        settings = settings.continued(any(views.name not in initial.codes.index for views in training.objects))
    trainer = Trainer(training, settings, args.device, processes)
    if initial:
        trainer.initialise_from(initial)
    if args.resume:
        trainer.load_state(_state_path(args))
    return trainer, training, held_out


def _state_path(args: argparse.Namespace) -> Path:
    return args.out.with_suffix(".state")


def _train_and_save(args: argparse.Namespace, trainer: Trainer, held_out: Dataset) -> None:
    """Train under a progress bar; regularly write the model, the run's state and its curve."""
    curve = args.out.with_suffix(".curve.json")
    points = read_curve(curve) if args.resume else []
    with tqdm(total=args.steps, initial=trainer.step, unit="step", smoothing=0.01, disable=None) as bar:
        for step in trainer.steps():
            bar.update()
            if step.step % 100 == 0:
                bar.set_postfix_str(f"rays {step.psnr:.2f} dB")
            if step.step % _CHECKPOINT_EVERY == 0 or step.step == step.steps:
                model = trainer.model()
                model.save(args.out)
                trainer.save_state(_state_path(args))
                held_out_quality = held_out_psnr(model, held_out)
                tqdm.write(f"step {step.step}: {held_out_quality:.2f} dB on held-out views, {step.seconds:.0f} s")
                points.append(CurvePoint(step.step, step.seconds, held_out_quality))
                write_curve(curve, args.out.stem, points)


def train_viewpoint_classifier(args: argparse.Namespace) -> None:
    """Run ``train-viewpoint``: train a model's viewpoint classifier, as ``train`` does last."""
    require_writable(args.out)
    model = load_model(args.model)
    dataset = read_dataset(args.datasets, scale=args.pose_scale)
    if model.category not in ("", dataset.category):
        raise ValueError(f"the dataset shows {dataset.category}, but the model {model.category}")
    _save_complete(_with_viewpoint(model, dataset, args.steps, args.seed), args.out)


def train_part_head(args: argparse.Namespace) -> None:
    """Run ``train-parts``: train a part head by that of another model."""
    require_writable(args.out)
    model = load_model(args.model)
    teacher = load_model(args.labels)
    labelled = list(tqdm(labelled_places(model, teacher, args.objects), desc="parts", unit="object", disable=None))
    assert teacher.part_head
    names = teacher.part_head.names
    training, validation = _split(labelled)
    features, labels = (torch.cat(values) for values in zip(*validation, strict=True))
    predicted = fit_part_head(names, training)(features).argmax(1)
    accuracy = 100 * float((predicted == labels).float().mean())
    _save_complete(replace(model, part_head=fit_part_head(names, labelled)), args.out)
    print(f"{', '.join(names)}: {accuracy:.1f} % of the surface of {len(validation)} held-out objects")


def _save_complete(model: Model, path: Path) -> None:
    """Save a model; where its architecture can be fitted, with a view bank and the words of its directions."""
    if model.is_ablation:
        model.save(path)
        return
    wait_for_view_bank(model)
    *_, words = direction_words(model)
    replace(model, view_bank=view_bank(model), words=words).save(path)


def _with_viewpoint(model: Model, dataset: Dataset, steps: int, seed: int) -> Model:
    """Return the model with a viewpoint classifier, trained on most objects and measured on the others."""
    training, validation = _split(dataset.objects)
    torch.manual_seed(seed)
    classifier = ViewpointClassifier()
    stream = train_viewpoint(classifier, viewpoint_dataset(replace(dataset, objects=training)), steps, seed)
    for _ in tqdm(stream, total=steps, desc="viewpoint", unit="step", disable=None):
        pass
    hits = 100 * accuracy_within(classifier, viewpoint_dataset(replace(dataset, objects=validation)), _VALIDATION_ANGLE)
    tqdm.write(f"viewpoint: {hits:.0f} % of held-out views within {math.degrees(_VALIDATION_ANGLE):.0f} degrees")
    return replace(model, viewpoint_classifier=classifier)


def _split(objects: Sequence[_Object]) -> tuple[tuple[_Object, ...], tuple[_Object, ...]]:
    """Return the objects to train on, and every 20th to measure on; one alone serves for both."""
    training = tuple(item for index, item in enumerate(objects) if index % _VALIDATION_STRIDE)
    validation = tuple(objects[::_VALIDATION_STRIDE])
    return training or validation, validation


def convert(args: argparse.Namespace) -> None:
    """Run ``convert``: write a checkpoint of the authors' trainer as a model file."""
    require_writable(args.out)
    if args.out.suffix != ".safetensors":
        raise ValueError(f"{args.out.name}: a model file must end in .safetensors")
    model = load_authors(args.checkpoint, args.config)
    _save_complete(model, args.out)
    lost = ", ".join(str(index) for index in sorted(model.codes.collapsed))
    print(f"{len(model.codes)} {model.category}" + (f"; excluded as nearly empty: {lost}" if lost else ""))
