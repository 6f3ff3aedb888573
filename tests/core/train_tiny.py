"""Train the tiny model of the tests and write its weights: ``python -m tests.core.train_tiny``.

No test runs this. Other weights change the results of most tests.
"""

import torch
from safetensors.torch import save_file

from core.models.field import Field
from tests.core.tiny import CONFIG, WEIGHTS


def main() -> None:
    """Train for some seconds."""
    torch.manual_seed(0)
    field = Field(CONFIG)
    _learn(field, torch.Generator().manual_seed(0))
    save_file(field.state_dict(), WEIGHTS)


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
        rendered = field.colour(features, field.direction_bias(directions), field.texture_bias(texture))
        opacity = (1 - torch.exp(-density * 0.05)).clamp(1e-6, 1 - 1e-6)
        loss = torch.nn.functional.binary_cross_entropy(opacity, inside)
        loss = loss + 4 * ((rendered - colour).square().mean(-1) * inside).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()


def _stool(points: torch.Tensor, shape: torch.Tensor, texture: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the opacity of points (0..1, its edge 0.015 wide) and their colours."""
    x, y, z = points.unbind(-1)
    height = 0.24 + 0.05 * shape[:, 0]
    width = 0.2 + 0.04 * shape[:, 1]
    seat = _box((x, y, z + 0.05), (width, 0.2, 0.1))
    back = _box((x, y + 0.2, z - height / 2), (width, 0.06, height / 2 + 0.05))
    arm = _box((x - width, y, z - 0.08), (0.06, 0.18, 0.08))
    distances = torch.stack((seat, back, arm), -1)
    hue = 0.5 + 0.22 * texture
    red = torch.stack((hue[:, 0], 0.25 * torch.ones_like(x), hue[:, 1]), -1)
    colours = torch.stack((red, 1 - red, torch.tensor([0.1, 0.2, 0.1]).expand_as(red)), -2)
    nearest = distances.argmax(-1)
    return (distances.amax(-1) / 0.015).sigmoid(), colours[torch.arange(len(x)), nearest]


def _box(offset: tuple[torch.Tensor, ...], half: tuple) -> torch.Tensor:
    return torch.stack([size - place.abs() for place, size in zip(offset, half, strict=True)], -1).amin(-1)


if __name__ == "__main__":
    main()
