"""The paint of parts in drawn photos: it ends at the photo's edges, everything else keeps its colour."""

import pytest
import torch
from jaxtyping import Float
from torch import Tensor

from core.detail.mixture import photo_paints

WHITE = (0.85, 0.86, 0.88)
TEAL = (0.25, 0.6, 0.65)
WOOD = (0.3, 0.2, 0.12)
BLUE = (0.1, 0.15, 0.45)
ORANGE = (0.9, 0.5, 0.1)
DARK = (0.08, 0.09, 0.1)
SIDE = 96


def drawn(*patches: tuple[slice, slice, tuple[float, float, float]]) -> Float[Tensor, "3 h w"]:
    """A photo of patches of colours, with the noise of a camera."""
    photo = 0.02 * torch.randn(3, SIDE, SIDE, generator=torch.Generator().manual_seed(0))
    for rows, columns, colour in patches:
        photo[:, rows, columns] += torch.tensor(colour)[:, None, None] - photo[:, rows, columns].mean()
    return photo.clamp(0, 1)


def region(rows: slice, columns: slice) -> Float[Tensor, "h w"]:
    mask = torch.zeros(SIDE, SIDE)
    mask[rows, columns] = 1
    return mask


ALL = slice(0, SIDE)
LEFT = slice(0, 60)
RIGHT = slice(60, SIDE)
SURE = torch.ones(SIDE, SIDE)


def shares(photo: Tensor, probabilities: dict[str, Tensor], weight: Tensor = SURE) -> dict[str, Tensor]:
    paints = photo_paints(photo, probabilities, weight)
    assert bool(torch.isfinite(paints.shares).all()) and bool(torch.isfinite(paints.colours).all())
    assert float(paints.shares.min()) >= 0 and float(paints.shares.max()) < 1.001
    return dict(zip(paints.names, paints.shares.float(), strict=True))


@pytest.mark.parametrize("paint", [WHITE, TEAL])
def test_paint_in_any_light_ends_at_the_photos_edge_and_leaves_out_lettering_and_lamps(
    paint: tuple[float, float, float],
) -> None:
    """The render's edge to the glass is four px beside the photo's."""
    shade = slice(60, SIDE), LEFT, tuple(0.6 * channel for channel in paint)
    letters = slice(20, 26), slice(10, 40), BLUE
    lamp = slice(40, 50), slice(10, 20), ORANGE
    photo = drawn((ALL, LEFT, paint), shade, (ALL, RIGHT, DARK), letters, lamp)
    wrong = slice(0, 64), slice(64, SIDE)
    probabilities = {name: region(ALL, columns) for name, columns in zip(("body", "glass"), wrong, strict=True)}
    body = shares(photo, probabilities)["body"]
    for rows, columns, *_ in (letters, lamp, (ALL, slice(61, SIDE))):
        assert float((body[rows, columns] > 0.5).float().mean()) < 0.05
    for rows, columns in ((slice(0, 18), slice(0, 59)), (slice(62, SIDE), slice(0, 59))):
        assert float((body[rows, columns] > 0.8).float().mean()) > 0.97


def test_parts_of_one_colour_divide_where_the_render_does() -> None:
    photo = drawn((ALL, ALL, TEAL))
    seat = shares(photo, {"seat": region(ALL, LEFT), "back": region(ALL, RIGHT)})["seat"]
    assert float(seat[:, :56].min()) > 0.9 and float(seat[:, 64:].max()) < 0.1


def test_materials_are_told_by_colour_in_every_part() -> None:
    """The upper half is the back: wood with cloth on it, which no part consists of alone."""
    cloth = slice(10, 40), slice(10, 86)
    photo = drawn((ALL, ALL, WOOD), (*cloth, TEAL), (slice(48, 72), ALL, TEAL))
    rows = {"back": slice(0, 48), "seat": slice(48, 72), "legs": slice(72, SIDE)}
    by_name = shares(photo, {name: region(band, ALL) for name, band in rows.items()})
    assert float(by_name["fabric"][cloth].mean()) > 0.95 > 0.05 > float(by_name["wood"][cloth].mean())
    assert float(by_name["wood"][:8].mean()) > 0.95 > 0.05 > float(by_name["fabric"][:8].mean())
    assert float(by_name["seat"][:40].max()) < 0.05


@pytest.mark.parametrize("pixels", [0, 1, 2])
@pytest.mark.parametrize("names", [(), ("seat", "legs")])
def test_few_certain_pixels_give_finite_shares(pixels: int, names: tuple[str, ...]) -> None:
    weight = torch.zeros(SIDE, SIDE)
    weight[0, :pixels] = 1
    shares(torch.rand(3, SIDE, SIDE), {name: region(ALL, LEFT) for name in names}, weight)
