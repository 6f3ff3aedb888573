"""Training (Eq. 4): the field and both code books from posed pictures, looking only where the object can be."""

import copy
import math
import pickle
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.nn import functional

from core.datasets.srn import Dataset, ObjectViews
from core.files import atomic_file
from core.geometry.rays import Rays, cast_rays, ray_points, stratified, uniform_edges
from core.metrics import psnr
from core.models.ablations import build_field
from core.models.codes import CodeBook, Entry
from core.models.field import Field, FieldConfig
from core.models.model import Model
from core.models.precision import autocast, matmul_dtype, require_device
from core.rendering.compositing import composite_on_white, compositing_weights
from core.rendering.reference import render_exact
from core.training.visual_hull import grid_centres, shared_extent, visual_hull

_HULL_CELLS = 64
"""Cells of a hull along each axis: a cell is about one pixel of the training pictures."""
_EMPTY = 0.02
"""A cell that takes less of the light than this is empty."""
_PRUNED_AT = (0.08, 0.2, 0.4, 0.7)
"""Shares of the schedule after which hulls are pruned to where the field has found the object."""
_SETTLED = 2000
"""Steps before which nothing is pruned: what the field has not found yet is not empty."""
_BATCH = 512
"""Points are evaluated in multiples of this."""
_DARK = 1e-3
"""A sample that less of its ray's light reaches changes nothing that could be seen, so it is not trained on."""
_CHUNK_POINTS = 8192
"""Points looked through at a time: few enough that activations stay in cache."""
_LEAST_SIDE = 8
"""A matrix of fewer rows or columns (density's, colour's) is left to AdamW."""
_GENTLER = 0.05
"""Peak learning rates of a network that is trained already, against those of a fresh one. With 0.3 the shipped cars
lost 0.3 dB in 8,000 steps, with this they keep to 0.1 dB what they had in 2,500."""
_DECAY = 1e-4
"""of the weights, per step and learning rate"""
_BORDER = 3
"""px around the mask from which rays are drawn too: as far as the hull may reach beyond the object."""


@dataclass(frozen=True)
class TrainSettings:
    """How long and how to train."""

    field: FieldConfig = field(default_factory=FieldConfig)
    steps: int = 100_000
    rays: int = 768
    samples: int = 64
    """intervals along a ray through the box; only those inside the hull are evaluated"""
    outside: int = 768
    """points outside the hulls whose density is penalised, per step"""
    matrix_rate: float | None = 1e-2
    """peak learning rate of the network's matrices, by Muon; None: by AdamW like all else, as in the paper"""
    network_rate: float = 1e-3
    """peak learning rate of the rest of the network; the paper's is 1e-4"""
    code_rate: float = 4e-3
    """peak learning rate of the codes; the paper's is 1e-3"""
    everywhere: bool = False
    """as in the paper: rays through any pixel, sampled through the whole box; no hull is asked"""
    prior: float = 1e-4
    """weight of the squared norm of the codes, 1 / nu^2"""
    emptiness: float = 0.5
    """weight of the density found outside the hulls"""
    silhouette: float = 0.1
    """weight of the squared error of the opacity against the mask, off the mask's border"""
    average: float = 0.999
    """decay of the moving average of the weights"""
    seed: int = 0

    @property
    def gentler(self) -> "TrainSettings":
        """The same for a network that is trained already: what it has learnt must not be shaken off."""
        matrices = None if self.matrix_rate is None else _GENTLER * self.matrix_rate
        network, codes = _GENTLER * self.network_rate, _GENTLER * self.code_rate
        return replace(self, matrix_rate=matrices, network_rate=network, code_rate=codes)


RECIPES = {
    "ours": TrainSettings(),
    # Sections 3.2 and 4; kinder than theirs in three things: objects are mixed in a batch, the ground is white without
    # having to be painted, and rays are sampled in the box that the objects share.
    "paper": TrainSettings(
        field=FieldConfig(
            width=256,
            shape_blocks=2,
            shape_latent=256,
            texture_latent=256,
            position_frequencies=10,
            density_scale=1.0,
            bounded_colour=False,
        ),
        everywhere=True,
        outside=0,
        matrix_rate=None,
        network_rate=1e-4,
        code_rate=1e-3,
        emptiness=0.0,
        silhouette=0.0,
        average=0.0,
    ),
    "M1": TrainSettings(field=FieldConfig(architecture="M1")),
    "M2": TrainSettings(field=FieldConfig(architecture="M2")),
}
"""Ours, the paper's (its network, loss, samples and rates), and ours with the designs of
:mod:`core.models.ablations`.
"""


@dataclass(frozen=True)
class TrainStep:
    """Where a training run stands."""

    step: int
    steps: int
    loss: float
    psnr: float
    """dB of this step's rays, which lie on and around the objects"""
    seconds: float
    """spent on training, resumed runs included"""


class _RayBank:
    """All training pixels on and around the objects, or all there are, ready to be drawn from."""

    def __init__(
        self, dataset: Dataset, extent: tuple[float, float, float], device: torch.device, everywhere: bool
    ) -> None:
        objects = dataset.objects
        cameras = [camera for views in objects for camera in views.cameras]
        self.size = (dataset.image_size, dataset.image_size)
        self.focal = dataset.focal
        self.extent = torch.tensor(extent, device=device)
        angles = [(camera.azimuth, camera.elevation, camera.distance) for camera in cameras]
        self.angles = torch.tensor(angles, device=device)
        owners = [index for index, views in enumerate(objects) for _ in views.cameras]
        self.owner = torch.tensor(owners, device=device)
        self.images = torch.from_numpy(np.concatenate([views.images for views in objects])).to(device).flatten(1, 2)
        masks = torch.from_numpy(np.concatenate([views.masks for views in objects]))
        kind = _grown(masks, 1).to(torch.uint8) + (~_grown(~masks, 1)).to(torch.uint8)
        self.kind = kind.flatten(1).to(device)
        self.everywhere = everywhere
        if everywhere:
            self.hulls = torch.ones(len(objects), *[_HULL_CELLS] * 3, dtype=torch.bool, device=device)
            return
        view, pixel = _grown(masks, _BORDER).flatten(1).nonzero(as_tuple=True)
        self.view, self.pixel = view.to(torch.int32).to(device), pixel.to(torch.int32).to(device)
        self.hulls = torch.stack([visual_hull(views, extent, _HULL_CELLS) for views in objects]).to(device)

    def draw(self, count: int, generator: torch.Generator) -> tuple[Rays, Int[Tensor, "rays"], Tensor, Tensor]:
        """Rays with the objects they meet, their colours (0..1), and 0, 1 or 2 for off, across or on the object."""
        view, pixel = self._places(count, generator)
        width = self.size[0]
        centres = torch.stack((pixel % width, pixel // width), -1) + 0.5
        azimuth, elevation, distance = self.angles[view].unbind(-1)
        rays = cast_rays(centres, azimuth, elevation, distance, self.focal, self.size, self.extent)
        return rays, self.owner[view], self.images[view, pixel].float() / 255, self.kind[view, pixel]

    def _places(self, count: int, generator: torch.Generator) -> tuple[Int[Tensor, "rays"], Int[Tensor, "rays"]]:
        """Views, and pixels of theirs."""
        device = self.images.device
        if self.everywhere:
            views, pixels = self.images.shape[:2]
            view, pixel = (torch.randint(n, (count,), generator=generator, device=device) for n in (views, pixels))
            return view, pixel
        at = torch.randint(len(self.view), (count,), generator=generator, device=device)
        return self.view[at].long(), self.pixel[at].long()

    def inside(self, points: Float[Tensor, "*batch 3"], owner: Int[Tensor, "*#batch"]) -> Tensor:
        """Whether each point lies in its object's hull."""
        cells = ((points / self.extent + 1) * (_HULL_CELLS / 2)).long().clamp(0, _HULL_CELLS - 1)
        x, y, z = cells.unbind(-1)
        return self.hulls.flatten()[((owner * _HULL_CELLS + x) * _HULL_CELLS + y) * _HULL_CELLS + z]

    @torch.no_grad()
    def prune(self, field: Field, shape_bias: Float[Tensor, "objects blocks width"]) -> None:
        """Drop the cells that the field has found empty and whose neighbours are empty too."""
        centres = grid_centres(tuple(self.extent.tolist()), _HULL_CELLS).to(self.extent.device)
        step = 2 * self.extent.amin() / _HULL_CELLS
        for hull, bias in zip(self.hulls, shape_bias, strict=True):
            cells = hull.flatten().nonzero()[:, 0]
            with autocast(hull.device):
                found = [field.density(centres[part], bias)[0] for part in cells.split(16384)]
            taken = torch.zeros(hull.numel(), device=hull.device)
            taken[cells] = -torch.expm1(-torch.cat(found) * step)
            near = functional.max_pool3d(taken.reshape(1, *hull.shape), 3, 1, 1)[0]
            hull &= near > _EMPTY


def _padded(indices: Int[Tensor, "some"]) -> Int[Tensor, "more"]:
    """Indices with their first repeated up to a multiple of ``_BATCH``.

    The processor's matrix library compiles a kernel for every size that it has not met.
    """
    return functional.pad(indices, (0, -len(indices) % _BATCH), value=int(indices[0]) if len(indices) else 0)


def _grown(masks: Bool[Tensor, "views height width"], reach: int) -> Bool[Tensor, "views height width"]:
    """Masks dilated by ``reach`` px."""
    return functional.max_pool2d(masks[:, None].float(), 2 * reach + 1, 1, reach)[:, 0] > 0


class Trainer:
    """A training run: its whole state, saved and resumed to the step."""

    def __init__(self, dataset: Dataset, settings: TrainSettings, device: str = "cpu") -> None:
        self.settings, self.dataset = settings, dataset
        self.device = require_device(device)
        self.generator = torch.Generator(device).manual_seed(settings.seed)
        torch.manual_seed(settings.seed)
        self.extent = shared_extent(dataset.objects)
        self.bank = _RayBank(dataset, self.extent, self.device, settings.everywhere)
        self.entries, shapes, textures = _entries(dataset)
        config = settings.field
        self.field = build_field(config).to(self.device)
        self.shapes = nn.Parameter(_first_codes(shapes, config.shape_latent).to(self.device))
        self.textures = nn.Parameter(_first_codes(textures, config.texture_latent).to(self.device))
        self.averages = [parameter.detach().clone() for parameter in self._parameters()]
        self.optimisers = self._optimisers()
        rows = torch.tensor([(entry.shape, entry.texture) for entry in self.entries], device=self.device)
        self.shape_row, self.texture_row = rows.unbind(-1)
        self._prunings = () if settings.everywhere else tuple(int(share * settings.steps) for share in _PRUNED_AT)
        self.step, self.seconds = 0, 0.0

    def _optimisers(self) -> list[torch.optim.Optimizer]:
        """What moves the network and the codes; ``rate`` names the setting that is a group's highest learning rate."""
        settings, matrices = self.settings, list[nn.Parameter]()
        if settings.matrix_rate is not None:
            matrices = [one for one in self.field.parameters() if one.ndim == 2 and min(one.shape) >= _LEAST_SIDE]
        rest = [one for one in self.field.parameters() if all(one is not matrix for matrix in matrices)]
        codes = [self.shapes, self.textures]
        groups = {"params": rest, "rate": "network_rate"}, {"params": codes, "rate": "code_rate"}
        adam = torch.optim.AdamW(groups, weight_decay=_DECAY, eps=1e-12, fused=True)
        if settings.matrix_rate is None:
            return [adam]
        group = {"params": matrices, "rate": "matrix_rate"}
        return [adam, torch.optim.Muon([group], weight_decay=_DECAY, adjust_lr_fn="match_rms_adamw")]

    def begin_from(self, model: Model) -> None:
        """Start from a trained model: its network, and its codes of all objects that are in the dataset too.

        Shapes and textures that it does not know start from its mean ones. Raises ``ValueError`` where it is of
        another category or of other sizes.
        """
        if (model.category, model.field.config) != (self.dataset.category, self.settings.field):
            raise ValueError(f"training cannot go on from a model of {model.category} with {model.field.config}")
        self.field.load_state_dict(model.field.state_dict())
        known = {entry.name: index for index, entry in enumerate(model.codes.objects)}
        with torch.no_grad():
            self.shapes.copy_(model.codes.mean.shape.expand_as(self.shapes))
            self.textures.copy_(model.codes.mean.texture.expand_as(self.textures))
            for entry in self.entries:
                if entry.name in known:
                    codes = model.codes[known[entry.name]]
                    self.shapes[entry.shape], self.textures[entry.texture] = codes.shape, codes.texture
        self.averages = [parameter.detach().clone() for parameter in self._parameters()]

    def steps(self) -> Iterator[TrainStep]:
        """Train to the end of the schedule, one step per value; to stop, ask for no more."""
        while self.step < self.settings.steps:
            began = time.perf_counter()
            if self.step >= _SETTLED and self.step in self._prunings:
                self.bank.prune(self.field, self.field.shape_bias(self.shapes[self.shape_row]))
            loss, error = self._advance()
            self.step += 1
            self.seconds += time.perf_counter() - began
            if not math.isfinite(loss):
                raise ValueError(f"training diverged at step {self.step}: lower the learning rates")
            yield TrainStep(self.step, self.settings.steps, loss, -10 * math.log10(max(error, 1e-12)), self.seconds)

    def model(self) -> Model:
        """The model as it stands, from the moving average of the weights."""
        now, averaged = self._parameters(), copy.deepcopy(self.field).cpu()
        *layers, shapes, textures = self.averages
        assert len(layers) == len(now) - 2
        for parameter, value in zip(averaged.parameters(), layers, strict=True):
            parameter.data.copy_(value)
        book = CodeBook(shapes.clone().cpu(), textures.clone().cpu(), self.entries)
        distances = [camera.distance for views in self.dataset.objects for camera in views.cameras]
        size, focal = self.dataset.image_size, self.dataset.focal
        typical = float(np.median(distances))
        return Model(averaged, book, self.extent, self.dataset.category, size, focal, typical)

    def save_state(self, path: Path) -> None:
        """Write everything that :meth:`load_state` needs; an interrupted write leaves the last file whole."""
        state = {
            "objects": [entry.name for entry in self.entries],
            "field": self.field.state_dict(),
            "codes": (self.shapes.detach(), self.textures.detach()),
            "averages": self.averages,
            "optimisers": [optimiser.state_dict() for optimiser in self.optimisers],
            "generator": self.generator.get_state(),
            "hulls": self.bank.hulls,
            "progress": (self.step, self.seconds),
        }
        with atomic_file(path) as partial:
            torch.save(state, partial)

    def load_state(self, path: Path) -> None:
        """Go on where a saved run stood. Raises ``ValueError`` where it had another size or other objects."""
        try:
            state = torch.load(path, map_location=self.device, weights_only=True)
            if state["objects"] != [entry.name for entry in self.entries]:
                raise ValueError("it is of other objects, or of the same in another order")
            self.field.load_state_dict(state["field"])
            with torch.no_grad():
                for parameter, value in zip((self.shapes, self.textures), state["codes"], strict=True):
                    parameter.copy_(value)
            self.averages = state["averages"]
            self.bank.hulls.copy_(state["hulls"])
            for optimiser, saved in zip(self.optimisers, state["optimisers"], strict=True):
                optimiser.load_state_dict(saved)
            self.generator.set_state(state["generator"].cpu())
            self.step, self.seconds = state["progress"]
        except (OSError, KeyError, ValueError, RuntimeError, pickle.UnpicklingError) as error:
            raise ValueError(f"{path} does not fit this dataset and these settings: {error}") from None

    def _advance(self) -> tuple[float, float]:
        """One optimisation step; its loss and its squared error."""
        rays, owner, truth, kind = self.bank.draw(self.settings.rays, self.generator)
        with autocast(self.device):
            loss, error = self._loss(rays, owner, truth, kind)
        for optimiser in self.optimisers:
            optimiser.zero_grad()
        loss.backward()
        for optimiser in self.optimisers:
            for group in optimiser.param_groups:
                group["lr"] = getattr(self.settings, group["rate"]) * self._rate(self.step)
            optimiser.step()
        decay = min(self.settings.average, (1 + self.step) / (10 + self.step))
        torch._foreach_lerp_(self.averages, [p.detach() for p in self._parameters()], 1 - decay)
        return float(loss.detach()), float(error.detach())

    def _loss(self, rays: Rays, owner: Tensor, truth: Tensor, kind: Tensor) -> tuple[Tensor, Tensor]:
        """Eq. 4 with the terms for silhouette and emptiness; and the squared error alone."""
        settings = self.settings
        edges = uniform_edges(rays, settings.samples)
        depths = stratified(edges, self.generator)
        points = ray_points(rays, depths)
        hit = self.bank.inside(points, owner[:, None]).flatten().nonzero()[:, 0]
        shape, texture = self.shapes[self.shape_row[owner]], self.textures[self.texture_row[owner]]
        of_rays = self.field.biases(shape, texture)
        if not settings.everywhere and settings.field.architecture != "M1":  # whose density depends on the direction
            hit = self._lit(hit, points, edges, of_rays[0])
        asked = _padded(hit)
        ray = asked // settings.samples
        towards = self.field.direction_bias(rays.directions).index_select(0, ray)
        biases = (bias.index_select(0, ray) for bias in of_rays)
        found, seen = self.field.radiance(points.flatten(0, 1)[asked], towards, *biases)
        density = depths.new_zeros(depths.numel()).index_copy(0, hit, found[: len(hit)]).view_as(depths)
        colours = points.new_zeros(depths.numel(), 3).index_copy(0, hit, seen[: len(hit)]).view_as(points)
        shares, left = compositing_weights(density, edges)
        error = functional.mse_loss(composite_on_white(shares, left, colours), truth)
        sure = kind != 1
        silhouette = ((1 - left - kind.float() / 2) * sure).square().sum() / sure.sum().clamp_min(1)
        prior = shape.square().sum(-1).mean() + texture.square().sum(-1).mean()
        loss = error + settings.silhouette * silhouette + settings.prior * prior
        return loss + settings.emptiness * self._stray_density() if settings.outside else loss, error

    @torch.no_grad()
    def _lit(self, hit: Tensor, points: Tensor, edges: Tensor, shape_bias: Tensor) -> Tensor:
        """Those of the samples that light reaches: three of five lie behind a surface once there is one."""
        density, shape_bias = edges.new_zeros(points[..., 0].numel()), shape_bias.to(matmul_dtype(self.device.type))
        for part in hit.split(_CHUNK_POINTS):
            asked = _padded(part)
            bias = shape_bias.index_select(0, asked // points.shape[1])
            found = self.field.density(points.flatten(0, 1).index_select(0, asked), bias)[0]
            density[part] = found[: len(part)]
        passed = (density.view(points.shape[:-1]) * edges.diff(dim=-1)).cumsum(-1)
        dark = functional.pad(passed, (1, -1)) > -math.log(_DARK)
        return hit[~dark.flatten()[hit]]

    def _stray_density(self) -> Tensor:
        """The mean share of light that density outside the hulls would take within one interval of a ray.

        Half of the points are asked with an object's own shape code, half with a mix of two objects' codes, where
        neither has a hull: what lies between two objects stays as clean as they are.
        """
        count, dice, device = self.settings.outside, self.generator, self.device
        points = (torch.rand(count, 3, generator=dice, device=device) * 2 - 1) * self.bank.extent
        first, second = torch.randint(len(self.entries), (2, count), generator=dice, device=device)
        second[: count // 2] = first[: count // 2]
        outside = ~(self.bank.inside(points, first) | self.bank.inside(points, second))
        share = torch.rand(count, 1, generator=dice, device=device)
        shape = torch.lerp(self.shapes[self.shape_row[first]], self.shapes[self.shape_row[second]], share)
        texture = torch.lerp(self.textures[self.texture_row[first]], self.textures[self.texture_row[second]], share)
        density, _ = self.field.density(points, self.field.biases(shape, texture)[0])
        step = 2 * self.bank.extent.amin() / self.settings.samples
        return (-torch.expm1(-density * step) * outside).mean()

    def _parameters(self) -> list[Tensor]:
        return [*self.field.parameters(), self.shapes, self.textures]

    def _rate(self, step: int) -> float:
        """The learning rates' factor: a short climb, then a half cosine down to a hundredth."""
        climb = min(1.0, (step + 1) / 500)
        return climb * (0.01 + 0.99 * (1 + math.cos(math.pi * min(1.0, step / self.settings.steps))) / 2)


def hold_out(dataset: Dataset, objects: int = 8) -> tuple[Dataset, Dataset]:
    """The dataset without the last view of every object, and that view of a few objects spread over the dataset."""

    def part(views: ObjectViews, kept: slice) -> ObjectViews:
        return replace(views, images=views.images[kept], masks=views.masks[kept], cameras=views.cameras[kept])

    if min(len(views.cameras) for views in dataset.objects) < 2:
        raise ValueError("training needs at least two views of every object: one is held out to measure by")
    rest = tuple(part(views, slice(None, -1)) for views in dataset.objects)
    some = dataset.objects[:: max(1, len(dataset.objects) // objects)][:objects]
    held = tuple(part(views, slice(-1, None)) for views in some)
    return replace(dataset, objects=rest), replace(dataset, objects=held)


def held_out_psnr(model: Model, dataset: Dataset, samples: int = 64) -> float:
    """Mean PSNR (dB) of whole pictures of a model's own objects against a dataset of views not trained on."""
    index = {entry.name: row for row, entry in enumerate(model.codes.objects)}
    found = []
    for views in dataset.objects:
        codes = model.codes[index[views.name]]
        for image, camera in zip(views.images, views.cameras, strict=True):
            colour = render_exact(model, codes, camera, samples).colour.clamp(0, 1)
            found.append(psnr(colour, torch.from_numpy(image).float() / 255))
    return sum(found) / len(found)


def _first_codes(count: int, latent: int) -> Tensor:
    """Codes before training: small and random, as the authors draw them."""
    return torch.randn(count, latent) / math.sqrt(latent / 2)


def _entries(dataset: Dataset) -> tuple[tuple[Entry, ...], int, int]:
    """The code book's objects, and how many shapes and textures they share."""
    shapes: dict[str, int] = {}
    textures: dict[str, int] = {}
    entries = tuple(
        Entry(
            views.name,
            shapes.setdefault(views.shape_id, len(shapes)),
            textures.setdefault(views.texture_id, len(textures)),
        )
        for views in dataset.objects
    )
    return entries, len(shapes), len(textures)
