"""Effects of directions around a pixel against renders of moved codes, and motions of a shifted image."""

import pytest
import torch

from core.directions.grab import Pull, dragged_pull, image_motion, pulls_at
from core.geometry.camera import Camera
from core.models.model import Model
from core.rendering.reference import render_exact


@pytest.fixture(scope="module")
def camera(tiny: Model) -> Camera:
    return tiny.camera(1.1, 0.3).resized(96, 96)


def test_effects_are_those_of_moved_codes_and_empty_beside_the_object(tiny: Model, camera: Camera) -> None:
    instance = tiny[0]
    pulls = pulls_at(instance, camera, (48.0, 44.0))
    effects = {pull.direction: pull.effect for pull in pulls}
    assert [pull.effect for pull in pulls] == sorted(effects.values(), reverse=True)

    def square(amount: float, direction: torch.Tensor) -> torch.Tensor:
        rendered = render_exact(instance.changed(shape=instance.codes.shape + amount * direction), camera)
        return torch.cat((rendered.colour, rendered.opacity[..., None]), -1)[44 - 5 : 44 + 5, 48 - 5 : 48 + 5]

    step = 0.02
    expected = [
        float(((square(step, direction) - square(-step, direction)) / (2 * step)).square().mean().sqrt())
        for direction in tiny.codes.shape_space.basis[:6]
    ]
    assert pulls[0].direction == expected.index(max(expected))
    for direction, effect in enumerate(expected):
        assert effects[direction] == pytest.approx(effect, rel=0.35, abs=0.01)
    assert pulls_at(tiny[0], camera, (2.0, 2.0)) == []


def test_motions_are_measured_and_amounts_follow_drags() -> None:
    y, x = torch.meshgrid(torch.arange(9.0), torch.arange(9.0), indexing="ij")
    image = torch.stack((0.1 * x, 0.05 * y * y, 0.03 * x * y), -1)
    slopes = torch.stack((torch.gradient(image, dim=1)[0], torch.gradient(image, dim=0)[0]), -1)
    motions = torch.tensor([[2.0, -1.0], [0.0, 3.0]])
    measured = image_motion(image, -(slopes @ motions.T), 1.0)
    torch.testing.assert_close(measured, motions, rtol=1e-3, atol=1e-3)
    assert image_motion(torch.zeros(9, 9, 3), torch.ones(9, 9, 3, 2), 1.0).abs().max() == 0
    pull = Pull(2, 0.4, (10.0, -20.0))
    assert pull.amount((10.0, -20.0)) == pytest.approx(1.0)
    assert pull.amount((20.0, 10.0)) == pytest.approx(0.0)
    assert Pull(2, 0.4, (0.0, 0.0)).amount((5.0, 5.0)) == 0.0


def test_a_drag_chooses_the_direction_that_names_its_axis() -> None:
    camera = Camera(1.57, 0.1, 2.0, 300.0, 128, 128)  # from the front: width is across, height up
    pulls = [Pull(0, 0.5, (9.0, 9.0)), Pull(1, 0.3, (0.0, 5.0)), Pull(2, 0.3, (3.0, 4.0))]
    words = ("", "lower", "wider")
    top = (64.0, 30.0)
    bottom = (64.0, 98.0)
    up = dragged_pull(pulls, words, camera, top, (1.0, -8.0))
    assert up.direction == 1 and up.amount((0.0, -5.0)) == pytest.approx(-1.0, abs=0.01)
    assert dragged_pull(pulls, words, camera, bottom, (1.0, 8.0)).amount((0.0, 5.0)) == pytest.approx(-1.0, abs=0.01)
    side = dragged_pull(pulls, words, camera, (98.0, 64.0), (8.0, 1.0))
    assert side.direction == 2 and side.amount((5.0, 0.0)) == pytest.approx(1.0, abs=0.01)
    assert dragged_pull(pulls, ("", "", ""), camera, top, (0.0, -8.0)) == pulls[0]
    assert dragged_pull([pulls[0], pulls[1]._replace(effect=0.01)], words, camera, top, (0.0, -8.0)) == pulls[0]
