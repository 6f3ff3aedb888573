import pytest
import torch

from core.fitting.pieces import Piece, cells_of, map_rays


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 2, 300), (3, 1, 5), (40, 1, 64), (7, 3, 1)])
@pytest.mark.parametrize("samples", [2, 1000])
def test_pieces_cover_all_rays_once(shape: tuple[int, int, int], samples: int):
    number = torch.arange(torch.Size(shape).numel()).reshape(shape)
    pieces = list[int]()

    def function(piece: Piece) -> tuple[torch.Tensor, torch.Tensor]:
        pieces.append(number[piece].numel())
        return number[piece], torch.stack((number[piece], -number[piece]), -1).float()

    first, second = map_rays(function, number.shape, samples)
    assert torch.equal(first, number)
    assert torch.equal(second, torch.stack((number, -number), -1))
    assert sum(pieces) == number.numel()  # none twice
    assert min(pieces) > 0


def test_a_single_grid_serves_every_hypothesis():
    cells = torch.rand(3, 2, 2, 2) > 0.5
    assert cells_of(None, slice(1, 2)) is None
    assert torch.equal(cells_of(cells, slice(1, 3)), cells[1:])
    assert torch.equal(cells_of(cells[:1], slice(1, 3)), cells[:1])
