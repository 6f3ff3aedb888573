"""The paper's own recipe (section 3.3), the baseline of every chart: one start anywhere, mean codes, AdamW, Eq. 5."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool
from torch import Tensor

from core.fitting.hypotheses import Numbers, Objective, Pool, judged, within_bounds
from core.fitting.observations import Target, draw
from core.fitting.schedule import Stage
from core.geometry.camera import Camera
from core.models.model import Model

_RATES = {"angles": 0.1, "distance": 0.01, "codes": 0.01}
"""AdamW's; rad, scene units, numbers of a code"""
_HALVED_EVERY = 50
"""steps, in the authors' code"""


def entered(model: Model, given: Sequence[Camera], unknown: Bool[Tensor, "views"], generator: torch.Generator) -> Pool:
    """One hypothesis: the mean codes, and unknown cameras anywhere on the upper half at the usual distance."""
    known = torch.tensor([(camera.azimuth, camera.elevation) for camera in given])
    anywhere = torch.rand(len(given), 2, generator=generator)
    anywhere = torch.stack((2 * math.pi * anywhere[:, 0], anywhere[:, 1].asin()), -1)
    angles = torch.where(unknown[:, None], anywhere, known)[None]
    away = torch.tensor([[math.log(camera.distance / model.distance) for camera in given]])
    mean = model.codes.mean
    return Pool.of(
        Numbers(angles, away, torch.zeros_like(away), torch.zeros_like(angles), mean.shape[None], mean.texture[None])
    )


def descent(
    model: Model,
    pool: Pool,
    targets: Sequence[Target],
    stage: Stage,
    by: Objective,
    unknown: Bool[Tensor, "views"],
    generator: torch.Generator,
) -> Iterator[Pool]:
    """The pool after every step of AdamW, each on pixels of its own; of infinite cost once it has diverged."""
    searched = Numbers(*(part.clone().requires_grad_() for part in pool.numbers))
    rates = {
        "angles": _RATES["angles"],
        "distance": _RATES["distance"] / model.distance,
        "shape": _RATES["codes"],
        "texture": _RATES["codes"],
    }
    optimizer = torch.optim.AdamW([{"params": [getattr(searched, name)], "lr": rate} for name, rate in rates.items()])
    halving = torch.optim.lr_scheduler.StepLR(optimizer, _HALVED_EVERY, 0.5)
    for _ in range(stage.steps):
        drawn = draw(targets, stage.rays, generator)
        jitter = torch.rand(drawn.opaque.shape, generator=generator) - 0.5
        optimizer.zero_grad()
        found = judged(model, searched, drawn, stage.samples, by, jitter)
        found.objective.sum().backward()
        optimizer.step()
        halving.step()
        with torch.no_grad():
            _settle(searched, pool.numbers, unknown)
        cost = found.objective.detach()
        if not all(bool(part.isfinite().all()) for part in (cost, *searched)):
            cost = torch.full_like(cost, math.inf)
        numbers = Numbers(*(part.detach().clone() for part in searched))
        yield replace(pool, numbers=numbers, cost=cost, squared=found.squared)


def _settle(searched: Numbers, before: Numbers, unknown: Bool[Tensor, "views"]) -> None:
    """Unknown cameras within what they can be, known ones back where they stood: AdamW moves them all."""
    bounded = within_bounds(searched, unknown)
    searched.angles.copy_(torch.where(unknown[:, None], bounded.angles, before.angles))
    searched.distance.copy_(torch.where(unknown, bounded.distance, before.distance))
