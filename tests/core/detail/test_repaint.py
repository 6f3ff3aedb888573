"""Repainting of patches of one colour: paint changes, everything else keeps the photo's colour."""

import pytest
import torch
from jaxtyping import Float
from torch import Tensor

from core.detail.lookup import ColourMatch
from core.detail.repaint import colour_match, light_share, moved_paint, repainted, replaced_share, same_paint
from core.geometry.pixels import lightness

WHITE = (0.85, 0.86, 0.88)
RED = (0.75, 0.19, 0.16)
BLACK = (0.05, 0.05, 0.06)
GOLD = (0.62, 0.45, 0.15)


def patch(*colours: tuple[float, float, float]) -> Float[Tensor, "3 places"]:
    return torch.tensor(colours).T


def painted(photo: Tensor, old_paint: Tensor, new_paint: Tensor, match: ColourMatch | None = None) -> Tensor:
    offset = (match or ColourMatch()).change(old_paint.T).T
    return repainted(photo, old_paint + offset, moved_paint(new_paint - old_paint, offset))


def test_photos_keep_every_bit_without_a_change() -> None:
    photo = torch.rand(3, 500, generator=torch.Generator().manual_seed(0))
    old_paint = torch.rand(3, 500, generator=torch.Generator().manual_seed(1))
    match = ColourMatch((1.2, 1.1, 0.9), (0.02, -0.1, 0.05))
    assert torch.equal(painted(photo, old_paint, old_paint, match), photo)


def test_new_paint_keeps_the_photos_light_and_drops_its_offset() -> None:
    shade = 0.6
    photo = torch.cat((patch(WHITE), shade * patch(WHITE)), 1)
    new = painted(photo, patch(WHITE, WHITE), patch(RED, RED))
    assert new[:, 0].tolist() == pytest.approx(RED, abs=1e-3)
    assert (new[:, 1] / shade).tolist() == pytest.approx(RED, abs=1e-3)
    match = ColourMatch(offset=(0.1, 0.1, 0.1))
    new = painted(patch(WHITE) + 0.1, patch(WHITE), patch(RED), match)
    assert new[:, 0].tolist() == pytest.approx(RED, abs=1e-3)


@pytest.mark.parametrize("paint", [WHITE, RED, GOLD])
def test_a_paint_is_the_same_in_light_and_shade_and_no_other_colour(paint: tuple[float, float, float]) -> None:
    lights = torch.tensor([0.6, 0.8, 1.0, 1.1]) * patch(paint)
    other_paints = patch(*({WHITE, RED, GOLD, BLACK, (0.1, 0.15, 0.4)} - {paint}))
    assert same_paint(lights, patch(paint)).min() > 0.95
    assert same_paint(other_paints, patch(paint)).max() < 0.2


def test_measures_are_bounded_at_the_extremes() -> None:
    greys = torch.linspace(0, 1, 11).repeat(3, 1)
    for paint in (0.0, 1e-9, 1.0):
        for measure in (light_share, same_paint):
            values = measure(greys, torch.full_like(greys, paint))
            assert bool(torch.isfinite(values).all()) and float(values.min()) >= 0 and float(values.max()) < 1.61
    assert float(lightness(torch.ones(3, 1))) == pytest.approx(1.0)
    assert replaced_share(torch.tensor([[0.0, 0, 0], [0.25, 0, 0], [-1, 0, 0]])).tolist() == [0.0, 0.5, 1.0]


def test_a_match_recovers_gain_and_offset_despite_outliers() -> None:
    generator = torch.Generator().manual_seed(2)
    colours = torch.rand(3, 4000, generator=generator)
    photo = 1.2 * colours - 0.1
    photo[:, :200] = 0.0
    match = colour_match(colours, photo, torch.ones(4000))
    assert match.gain == pytest.approx((1.2,) * 3, abs=0.1)
    matched = colours[:, 200:] + match.change(colours[:, 200:].T).T
    assert (matched - photo[:, 200:]).abs().mean() < 0.03
    match = colour_match(torch.rand(3, 10), torch.rand(3, 10), torch.zeros(10))
    assert match.gain == pytest.approx((1.0,) * 3) and match.offset == pytest.approx((0.0,) * 3)
