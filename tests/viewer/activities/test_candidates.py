from dataclasses import replace

import torch

from core.fitting.fit import FitStep, Hypothesis
from core.models.codes import Codes
from core.models.model import Model
from viewer.activities.candidates import update_tiles


def step(model: Model, seconds: float, *active: tuple[int, float, float]) -> FitStep:
    """Of hypotheses as start, azimuth and loss."""
    codes = model.codes.mean
    hypotheses = tuple(
        Hypothesis(start, loss, (model.camera(azimuth, 0.3),), codes, torch.zeros(1, 4))
        for start, azimuth, loss in active
    )
    best = hypotheses[0]
    return FitStep(1, 9, best.origin, best.loss, 20.0, seconds, best.cameras, codes, hypotheses=hypotheses)


def test_tiles_follow_their_hypotheses_and_are_ranked(model: Model) -> None:
    tiles = update_tiles((), step(model, 0.0, (0, 0.0, 0.1), (1, 2.0, 0.2), (2, 4.0, 0.3)))
    assert [tile.number for tile in tiles] == [0, 1, 2]
    tiles = update_tiles(tiles, step(model, 1.0, (2, 4.1, 0.05), (0, 0.1, 0.07), (1, 2.1, 0.1)))
    assert [tile.number for tile in tiles] == [2, 0, 1]
    assert [tile.hypothesis.loss for tile in tiles] == [0.05, 0.07, 0.1]
    tiles = update_tiles(tiles, step(model, 2.0, (1, 2.2, 0.04)))
    assert [(tile.number, tile.eliminated_at) for tile in tiles] == [(1, None), (2, 2.0), (0, 2.0)]
    tiles = update_tiles(tiles, step(model, 3.0, (1, 2.3, 0.03)))
    assert [(tile.number, tile.eliminated_at) for tile in tiles] == [(1, None), (2, 2.0), (0, 2.0)]


def test_the_opposite_view_of_a_candidate_is_a_tile_of_its_own(model: Model) -> None:
    tiles = update_tiles((), step(model, 0.0, (0, 0.0, 0.1), (1, 2.0, 0.2)))
    tiles = update_tiles(tiles, step(model, 1.0, (0, 0.1, 0.1), (0, 3.2, 0.3)))
    assert [(tile.number, tile.eliminated_at) for tile in tiles] == [(0, None), (2, None), (1, 1.0)]
    crossed = update_tiles(tiles, step(model, 2.0, (0, 3.3, 0.1), (0, 0.2, 0.2)))
    assert [tile.number for tile in crossed] == [2, 0, 1]


def test_a_fit_of_other_photos_has_other_tiles(model: Model) -> None:
    first = step(model, 0.0, (0, 0.0, 0.1))
    both = replace(first.hypotheses[0], cameras=first.cameras * 2, codes=Codes(first.codes.shape, first.codes.texture))
    tiles = update_tiles(update_tiles((), first), replace(first, hypotheses=(both,)))
    assert [(tile.number, tile.eliminated_at is None) for tile in tiles] == [(1, True), (0, False)]
