"""A tiny model of a real thing: lopsided stools of four shapes and four colours, learned in a few seconds."""

from functools import cache

import torch

from core.geometry.camera import Camera
from core.models.codes import CodeBook, Codes, Entry
from core.models.field import Field
from core.models.field_config import FieldConfig
from core.models.model import Model
from core.photos.photo import Photo
from core.rendering.reference import render_exact

EXTENT = (0.4, 0.4, 0.4)
SIDE = 40


@cache
def tiny_model() -> Model:
    """Seat, back, one arm rest: no symmetry. The first code makes it taller, the second wider; two more its hue."""
    generator = torch.Generator().manual_seed(0)
    config = FieldConfig(32, 2, 1, 2, 2, position_frequencies=3, direction_frequencies=0)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        field = Field(config)
    corners = torch.tensor([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
    _learn(field, generator)
    objects = tuple(Entry(f"stool{i}", i, (i * 3 + 1) % 4) for i in range(4))
    return Model(field, CodeBook(corners, corners.clone(), objects), EXTENT, "stools", SIDE, 60.0, 2.0)


def _learn(field: Field, generator: torch.Generator) -> None:
    optimiser = torch.optim.Adam(field.parameters(), 1e-2)
    steps, count = 1000, 2048
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 1e-2, total_steps=steps)
    for _ in range(steps):
        points = (torch.rand(count, 3, generator=generator) - 0.5) * 0.8
        shape, texture = (torch.rand(count, 2, generator=generator) * 3 - 1.5 for _ in range(2))
        directions = torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=-1)
        inside, colour = _stool(points, shape, texture)
        density, features = field.density(points, field.shape_bias(shape))
        seen = field.colour(features, field.direction_bias(directions), field.texture_bias(texture))
        shown = (1 - torch.exp(-density * 0.05)).clamp(1e-6, 1 - 1e-6)
        loss = torch.nn.functional.binary_cross_entropy(shown, inside)
        loss = loss + 4 * ((seen - colour).square().mean(-1) * inside).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()


def _stool(points: torch.Tensor, shape: torch.Tensor, texture: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """How far inside (0..1, soft over a hundredth) and the colour of each part."""
    x, y, z = points.unbind(-1)
    tall, wide = 0.24 + 0.05 * shape[:, 0], 0.2 + 0.04 * shape[:, 1]
    seat = _box((x, y, z + 0.05), (wide, 0.2, 0.1))
    back = _box((x, y + 0.2, z - tall / 2), (wide, 0.06, tall / 2 + 0.05))
    arm = _box((x - wide, y, z - 0.08), (0.06, 0.18, 0.08))
    parts = torch.stack((seat, back, arm), -1)
    hue = 0.5 + 0.22 * texture
    red = torch.stack((hue[:, 0], 0.25 * torch.ones_like(x), hue[:, 1]), -1)
    colours = torch.stack((red, 1 - red, torch.tensor([0.1, 0.2, 0.1]).expand_as(red)), -2)
    nearest = parts.argmax(-1)
    return (parts.amax(-1) / 0.015).sigmoid(), colours[torch.arange(len(x)), nearest]


def _box(offset: tuple[torch.Tensor, ...], half: tuple) -> torch.Tensor:
    return torch.stack([size - place.abs() for place, size in zip(offset, half, strict=True)], -1).amin(-1)


def photo_of(model: Model, codes: Codes, camera: Camera) -> Photo:
    """An image of one of a model's objects, with its mask."""
    seen = render_exact(model, codes, camera, 64)
    return Photo(seen.colour.clamp(0, 1), seen.opacity > 0.5)
