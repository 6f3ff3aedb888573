"""``dataset``, ``train``, ``glance`` and ``convert``: what models are made of, and from."""

import argparse
import json
import math
from dataclasses import replace

import torch
from tqdm import tqdm

from core.benchmarks.charts import write_training
from core.cli.progress import drive, require_place
from core.datasets.glb_objects import mesh_plan, render_meshes
from core.datasets.mesh_variants import cells
from core.datasets.procedural.table import procedural_plan, render_procedural, swap_plan
from core.datasets.srn import Dataset, read_dataset
from core.datasets.srn_cameras import SPIRAL_VIEWS
from core.models.authors_checkpoint import load_authors
from core.models.field import FieldConfig
from core.models.library import load_model
from core.models.model import Model
from core.models.viewpoint import ViewpointClassifier
from core.training.trainer import RECIPES, Trainer, held_out_psnr, hold_out
from core.training.viewpoint import glimpses, share_recognised, taught

_MEASURED_EVERY = 5000
"""Steps between two measurements of a model in training, which is saved at the same time."""
_GLANCE_SHARE = 12
"""One of so many steps of training is one of the glance's."""
_ASKED = 20
"""One of so many objects is kept to measure a glance by."""
_RECOGNISED = math.radians(15)
_VIEWS = {"train": 50, "test": SPIRAL_VIEWS}


def dataset_meshes(chosen: argparse.Namespace) -> None:
    """``dataset meshes``: GLB files rendered into SRN folders."""
    plan = mesh_plan(chosen.folder, chosen.category, chosen.split)
    views = chosen.views or _VIEWS[chosen.split]
    where = chosen.folder, chosen.out, chosen.category, chosen.split
    made = render_meshes(*where, views, chosen.size, chosen.variants)
    drive(made, len(plan) * len(cells(chosen.variants)), "object")


def dataset_procedural(chosen: argparse.Namespace) -> None:
    """``dataset procedural``: generated objects rendered into SRN folders."""
    plan = procedural_plan(chosen.category, chosen.count, chosen.split)
    views = chosen.views or _VIEWS[chosen.split]
    made = render_procedural(plan, chosen.category, chosen.out, chosen.split, views, chosen.size)
    drive(made, len(plan), "object")


def dataset_swap(chosen: argparse.Namespace) -> None:
    """``dataset swap``: trained and untrained pairs of procedural shapes and textures, for ``evaluate --swap``."""
    plan = swap_plan(chosen.category, chosen.count, chosen.blocks)
    made = render_procedural(plan, chosen.category, chosen.out, "test", chosen.views, chosen.size)
    drive(made, len(plan), "object")


def train(chosen: argparse.Namespace) -> None:
    """``train``: a model from datasets, saved with its state and its curve as it goes."""
    require_place(chosen.out)
    recipe = RECIPES[chosen.recipe]
    begin = load_model(chosen.begin) if chosen.begin else None
    settings = replace(recipe, field=_field(chosen, recipe.field, begin), steps=chosen.steps, seed=chosen.seed)
    training, held_out = hold_out(read_dataset(chosen.datasets))
    trainer = Trainer(training, settings.gentler if begin else settings, chosen.device)
    if begin:
        trainer.begin_from(begin)
    state, curve = chosen.out.with_suffix(".state"), chosen.out.with_suffix(".curve.json")
    points: list[dict[str, float]] = []
    if chosen.resume:
        trainer.load_state(state)
        points = next(iter(json.loads(curve.read_text()).values())) if curve.exists() else []
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
                points.append({"step": step.step, "seconds": step.seconds, "psnr": found})
                write_training({chosen.out.stem: points}, curve)
    if chosen.recipe == "ours":
        steps = max(1, chosen.steps // _GLANCE_SHARE)
        _taught(trainer.model(), training, steps, chosen.seed).save(chosen.out)


def glance(chosen: argparse.Namespace) -> None:
    """``glance``: teach a trained model to tell at a glance from where a picture is taken, as ``train`` does last."""
    require_place(chosen.out)
    model, dataset = load_model(chosen.model), read_dataset(chosen.datasets)
    if model.category not in ("", dataset.category):
        raise ValueError(f"the dataset shows {dataset.category}, and the model knows {model.category}")
    _taught(model, dataset, chosen.steps, chosen.seed).save(chosen.out)


def _taught(model: Model, dataset: Dataset, steps: int, seed: int) -> Model:
    """The model with a glance; some objects are only looked at to say how well it recognises."""
    asked = dataset.objects[::_ASKED]
    shown = [views for index, views in enumerate(dataset.objects) if index % _ASKED] or asked
    seen = glimpses(replace(dataset, objects=tuple(shown)))
    torch.manual_seed(seed)
    pupil = ViewpointClassifier()
    with tqdm(total=steps, desc="glance", unit="step", disable=None) as bar:
        for _ in taught(pupil, seen, steps, seed):
            bar.update()
    share = 100 * share_recognised(pupil, glimpses(replace(dataset, objects=asked)), _RECOGNISED)
    tqdm.write(f"of objects not looked at, {share:.0f} % of views are told to {math.degrees(_RECOGNISED):.0f} degrees")
    return replace(model, glance=pupil)


def _field(chosen: argparse.Namespace, usual: FieldConfig, begin: Model | None) -> FieldConfig:
    """The network's sizes, as told or as the model has them that training goes on from."""
    if begin:
        if chosen.width or chosen.latent or chosen.recipe != "ours":
            raise ValueError("--from has the sizes and the design of its model: no --width, --latent or --recipe")
        return begin.field.config
    shape, texture = chosen.latent or (usual.shape_latent, usual.texture_latent)
    return replace(usual, width=chosen.width or usual.width, shape_latent=shape, texture_latent=texture)


def convert(chosen: argparse.Namespace) -> None:
    """``convert``: a checkpoint of the authors' trainer as a model file."""
    require_place(chosen.out)
    if chosen.out.suffix != ".safetensors":
        raise ValueError(f"{chosen.out.name}: a model file is called .safetensors")
    model = load_authors(chosen.checkpoint, chosen.config)
    model.save(chosen.out)
    lost = ", ".join(str(index) for index in sorted(model.codes.broken))
    print(
        f"{len(model.codes)} {model.category}" + (f"; next to empty, so left out of the mean: {lost}" if lost else "")
    )
