"""Training (Eq. 4): the field and both code books from posed images."""

import copy
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional

from core.lab.datasets.categories import category_sizes
from core.lab.datasets.srn import Dataset
from core.lab.training.processes import ALONE, Processes
from core.lab.training.ray_dataset import RayBatch, RayDataset
from core.lab.training.recipes import TrainSettings
from core.lab.training.sample_placement import PlacedSamples, place_samples
from core.lab.training.visual_hull import shared_extent
from core.metrics import psnr_from_mse
from core.models.architecture_variants import build_field
from core.models.codes import CodeBook, Entry
from core.models.model import Model
from core.rendering.compositing import composite_on_white, compositing_weights
from core.runtime.files import atomic_file
from core.runtime.precision import autocast, require_device
from core.runtime.reading import first_line

_PRUNE_AT = (0.08, 0.2, 0.4, 0.7)  # Fractions of the schedule at which hulls are pruned to occupied cells
_PRUNE_AFTER = 2000  # steps before the first pruning: the field must have found the object
_OUTSIDE_INTERVALS = 64  # across the box: the interval by which density outside the hulls is penalised
_MIN_MUON_DIM = 8  # AdamW optimises matrices with fewer rows or columns (density, colour)
_WEIGHT_DECAY = 1e-4  # decay of the weights per step, relative to the learning rate
_WARMUP_STEPS = 500
_FINAL_LR = 0.01  # learning rates at the end of the schedule, relative to their peaks


@dataclass(frozen=True)
class TrainStep:
    """Progress of a training run."""

    step: int
    steps: int
    loss: float
    psnr: float  # dB of this step's rays on and around the objects
    seconds: float  # of training, including earlier runs


class Trainer:
    """A training run whose state can be saved and resumed at any step, by any number of processes."""

    def __init__(
        self, dataset: Dataset, settings: TrainSettings, device: str = "cpu", processes: Processes = ALONE
    ) -> None:
        self.settings = settings
        self.processes = processes
        self.dataset = replace(dataset, objects=())  # without the images, of which the rays are a copy
        self.distance = float(np.median([camera.distance for views in dataset.objects for camera in views.cameras]))
        self.device = require_device(device)
        self.generator = torch.Generator(device).manual_seed(settings.seed)
        torch.manual_seed(settings.seed)
        self.extent = shared_extent(dataset.objects, self.device)
        self.ray_dataset = RayDataset(dataset, self.extent, self.device, settings.whole_image, processes)
        objects = dataset.objects
        shapes = list(dict.fromkeys(views.shape_id for views in objects))
        textures = list(dict.fromkeys(views.texture_id for views in objects))
        rows = [(shapes.index(views.shape_id), textures.index(views.texture_id)) for views in objects]
        self.entries = tuple(Entry(views.name, *row) for views, row in zip(objects, rows, strict=True))
        self.shape_row, self.texture_row = torch.tensor(rows, device=self.device).unbind(-1)
        config = settings.field
        self.field = build_field(config).to(self.device)
        self.shapes = nn.Parameter(_initial_codes(len(shapes), config.shape_latent).to(self.device))
        self.textures = nn.Parameter(_initial_codes(len(textures), config.texture_latent).to(self.device))
        self.ema_parameters = [parameter.detach().clone() for parameter in self._parameters()]
        self.optimisers, self._peak_lrs = self._build_optimisers()
        self.step = 0
        self.seconds = 0.0
        self._ray_loss = self._evaluate_ray_loss
        if self.device.type == "cuda":  # of several processes, each has another number of rays in every step
            self._ray_loss = torch.compile(self._evaluate_ray_loss, dynamic=processes.count > 1)
        self.extends: tuple[str, ...] = ()  # see :attr:`core.models.model.Model.extends`

    def _build_optimisers(self) -> tuple[list[torch.optim.Optimizer], list[float]]:
        """Return the optimisers of network and codes, and the peak learning rate of each parameter group."""
        settings = self.settings
        matrices = list[nn.Parameter]()
        rest = list[nn.Parameter]()
        for weight in self.field.parameters():
            is_matrix = weight.ndim == 2 and min(weight.shape) >= _MIN_MUON_DIM
            (matrices if is_matrix and settings.muon_lr is not None else rest).append(weight)
        groups = {"params": rest}, {"params": [self.shapes, self.textures]}
        optimisers: list[torch.optim.Optimizer] = [
            torch.optim.AdamW(groups, weight_decay=_WEIGHT_DECAY, eps=1e-12, fused=True)
        ]
        peaks = [settings.network_lr, settings.code_lr]
        if settings.muon_lr is not None:
            muon = torch.optim.Muon(matrices, weight_decay=_WEIGHT_DECAY, adjust_lr_fn="match_rms_adamw")
            optimisers.append(muon)
            peaks.append(settings.muon_lr)
        return optimisers, peaks

    def initialise_from(self, model: Model) -> None:
        """Start from a trained model: its network, and its codes of all objects in the dataset.

        Unknown shapes and textures start from the model's means. Raises ``ValueError`` for a model of another category
        or with another network.
        """
        if (model.category, model.field.config) != (self.dataset.category, self.settings.field):
            raise ValueError(f"training cannot start from a model of {model.category} with {model.field.config}")
        self.field.load_state_dict(model.field.state_dict())
        index = model.codes.index
        with torch.no_grad():
            self.shapes.copy_(model.codes.mean.shape.expand_as(self.shapes))
            self.textures.copy_(model.codes.mean.texture.expand_as(self.textures))
            for entry in self.entries:
                if entry.name in index:
                    codes = model.codes[index[entry.name]]
                    self.shapes[entry.shape] = codes.shape
                    self.textures[entry.texture] = codes.texture
        self.ema_parameters = [parameter.detach().clone() for parameter in self._parameters()]
        self.extends = (model.fingerprint, *model.extends)

    def steps(self) -> Iterator[TrainStep]:
        """Train to the end of the schedule, yielding after each step. ``ValueError`` if the loss is not finite."""
        while self.step < self.settings.steps:
            began = time.perf_counter()
            if self._is_pruning_due():
                self.ray_dataset.prune(self.field, self.field.shape_bias(self.shapes[self.shape_row]))
            loss, error = self._optimise_step()
            self.step += 1
            self.seconds += time.perf_counter() - began
            if not math.isfinite(loss):
                raise ValueError(f"training diverged at step {self.step}: lower the learning rates")
            yield TrainStep(self.step, self.settings.steps, loss, psnr_from_mse(error), self.seconds)

    def model(self) -> Model:
        """Return the current model: averaged weights, codes rounded to half precision as in files."""
        averaged = copy.deepcopy(self.field).cpu()
        *layers, shapes, textures = self.ema_parameters
        for parameter, value in zip(averaged.parameters(), layers, strict=True):
            parameter.data.copy_(value)
        return Model(
            averaged,
            CodeBook(shapes.half().float().cpu(), textures.half().float().cpu(), self.entries),
            self.extent,
            self.dataset.category,
            self.dataset.image_size,
            self.dataset.focal,
            self.distance,
            extends=self.extends,
            metres=category_sizes(self.dataset.category).metres,
        )

    def save_state(self, path: Path) -> None:
        """Write all that :meth:`load_state` needs; an interrupted write keeps the previous file."""
        state = {
            "objects": [entry.name for entry in self.entries],
            "field": self.field.state_dict(),
            "codes": (self.shapes.detach(), self.textures.detach()),
            "averages": self.ema_parameters,
            "optimisers": [optimiser.state_dict() for optimiser in self.optimisers],
            "generator": self.generator.get_state(),
            "hulls": self.ray_dataset.hulls,
            "progress": (self.step, self.seconds),
        }
        with atomic_file(path) as partial:
            torch.save(state, partial)

    def load_state(self, path: Path) -> None:
        """Resume a saved run. Raises ``ValueError`` for other sizes or objects than this run's."""
        try:
            state = torch.load(path, map_location=self.device, weights_only=True)
            if state["objects"] != [entry.name for entry in self.entries]:
                raise ValueError("it belongs to other objects, or to another order")
            self.field.load_state_dict(state["field"])
            with torch.no_grad():
                for parameter, value in zip((self.shapes, self.textures), state["codes"], strict=True):
                    parameter.copy_(value)
            self.ema_parameters = state["averages"]
            self.ray_dataset.hulls.copy_(state["hulls"])
            for optimiser, saved in zip(self.optimisers, state["optimisers"], strict=True):
                optimiser.load_state_dict(saved)
            self.generator.set_state(state["generator"].cpu())
            self.step, self.seconds = state["progress"]
        except Exception as error:  # torch's reader raises any exception
            raise ValueError(f"{path} does not fit this dataset and these settings: {first_line(error)}") from error

    def _optimise_step(self) -> tuple[float, float]:
        """Optimise once; return loss and squared error."""
        batch = self.ray_dataset.sample(self.settings.rays, self.generator)
        with autocast(self.device):
            loss, error = self._loss(batch)
        for optimiser in self.optimisers:
            optimiser.zero_grad()
        loss.backward()
        gradients = [value.grad for value in self._parameters() if value.grad is not None]
        losses = torch.stack((loss.detach(), error.detach()))
        self.processes.add(*gradients, losses)
        groups = [group for optimiser in self.optimisers for group in optimiser.param_groups]
        for group, peak in zip(groups, self._peak_lrs, strict=True):
            group["lr"] = peak * self._lr_factor()
        for optimiser in self.optimisers:
            optimiser.step()
        decay = min(self.settings.ema_decay, (1 + self.step) / (10 + self.step))
        torch._foreach_lerp_(self.ema_parameters, [p.detach() for p in self._parameters()], 1 - decay)
        total, squared_error = losses.tolist()
        return total, squared_error

    def _loss(self, batch: RayBatch) -> tuple[Tensor, Tensor]:
        """Return Eq. 4 plus the terms for mask and empty space; and the squared error alone.

        Sums over all processes are the means over the batch.
        """
        settings = self.settings
        rows = self.shape_row[batch.owner], self.texture_row[batch.owner]
        certain = (batch.mask_class != 1).float().sum()
        self.processes.add(certain)
        loss, error = self._ray_loss(self._place_samples(batch, *rows), batch, *rows, certain)
        if settings.outside_points:
            loss = loss + settings.empty_space_weight * self._empty_space_loss()
        return loss, error

    def _place_samples(
        self, batch: RayBatch, shape_row: Int[Tensor, "rays"], texture_row: Int[Tensor, "rays"]
    ) -> PlacedSamples:
        settings = self.settings
        coarse = None
        # M1's density depends on the direction; the paper samples the whole ray.
        if not settings.whole_image and settings.field.architecture != "M1":
            with torch.no_grad():
                bias, _ = self.field.biases(self.shapes[shape_row], self.textures[texture_row])
            coarse = partial(self._coarse_density, bias=bias[:, None])
        inside = partial(self.ray_dataset.inside_hull, owner=batch.owner[:, None])
        jitter = torch.rand(settings.rays, settings.samples, generator=self.generator, device=self.device)
        return place_samples(batch.rays, jitter[batch.place], inside, coarse)

    def _coarse_density(
        self, points: Float[Tensor, "rays coarse 3"], bias: Float[Tensor, "rays 1 blocks width"]
    ) -> Float[Tensor, "rays coarse"]:
        return self.field.density(points, bias)[0].float()

    def _evaluate_ray_loss(
        self,
        samples: PlacedSamples,
        batch: RayBatch,
        shape_row: Int[Tensor, "rays"],
        texture_row: Int[Tensor, "rays"],
        certain_count: Float[Tensor, ""],
    ) -> tuple[Tensor, Tensor]:
        """Return loss and squared error of rays, as fractions of the whole batch's; compiled on a graphics card."""
        settings = self.settings
        shape = functional.embedding(shape_row, self.shapes)
        texture = functional.embedding(texture_row, self.textures)
        biases = [bias[:, None] for bias in self.field.biases(shape, texture)]
        direction = self.field.direction_bias(batch.rays.directions)[:, None]
        density, colours = self.field.radiance(samples.points, direction, *biases)
        weights, transmittance = compositing_weights(density.float(), samples.edges)
        residuals = composite_on_white(weights, transmittance, colours.float()) - batch.colours
        error = residuals.square().mean(-1).sum() / settings.rays
        certain = (batch.mask_class != 1).float()
        opacity_error = (1 - transmittance - batch.mask_class.float() / 2) * certain
        mask_loss = opacity_error.square().sum() / certain_count.clamp_min(1)
        prior = (shape.square().sum() + texture.square().sum()) / settings.rays
        return error + settings.mask_weight * mask_loss + settings.code_prior * prior, error

    def _empty_space_loss(self) -> Tensor:
        """Return the mean opacity of one ray interval at points outside the hulls, a sum of all processes.

        Half of the points use one object's shape code. The others use a mix of two objects' codes, outside both hulls,
        so that interpolated objects stay as clean as the originals.
        """
        count = self.settings.outside_points
        uniform = partial(torch.rand, generator=self.generator, device=self.device)
        points = (uniform(count, 3) * 2 - 1) * self.ray_dataset.extent
        first, second = torch.randint(len(self.entries), (2, count), generator=self.generator, device=self.device)
        second[: count // 2] = first[: count // 2]
        outside = ~(self.ray_dataset.inside_hull(points, first) | self.ray_dataset.inside_hull(points, second))
        mix = uniform(count, 1)
        shape = torch.lerp(self.shapes[self.shape_row[first]], self.shapes[self.shape_row[second]], mix)
        texture = torch.lerp(self.textures[self.texture_row[first]], self.textures[self.texture_row[second]], mix)
        objects_here = self.processes.own
        density, _ = self.field.density(
            points[objects_here], self.field.biases(shape[objects_here], texture[objects_here])[0]
        )
        step = 2 * self.ray_dataset.extent.amin() / _OUTSIDE_INTERVALS
        return (-torch.expm1(-density * step) * outside[objects_here]).sum() / count

    def _is_pruning_due(self) -> bool:
        """Return True at the step that reaches a fraction of the schedule at which hulls are pruned."""
        previous = (self.step - 1) / self.settings.steps
        fraction_done = self.step / self.settings.steps
        reached = any(previous < fraction <= fraction_done for fraction in _PRUNE_AT)
        return reached and self.step >= _PRUNE_AFTER and not self.settings.whole_image

    def _parameters(self) -> list[Tensor]:
        return [*self.field.parameters(), self.shapes, self.textures]

    def _lr_factor(self) -> float:
        """Return the learning rate relative to its peak: a short linear warm-up, then a half cosine."""
        warmup = min(1.0, (self.step + 1) / _WARMUP_STEPS)
        cosine = (1 + math.cos(math.pi * min(1.0, self.step / self.settings.steps))) / 2
        return warmup * (_FINAL_LR + (1 - _FINAL_LR) * cosine)


def _initial_codes(count: int, latent: int) -> Float[Tensor, "count latent"]:
    """Initialise codes: small and random, as in the authors' code."""
    return torch.randn(count, latent) / math.sqrt(latent / 2)
