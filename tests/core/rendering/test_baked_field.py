import torch

from core.rendering.baked_field import cell_distances, logit_texels, logits_of


def test_distances_are_those_to_the_nearest_occupied_cell() -> None:
    generator = torch.Generator().manual_seed(0)
    cells = torch.rand(64, 64, 64, generator=generator) < 2e-4
    distance, occupied = cell_distances(cells).astype(int), cells.nonzero()
    assert 0 < len(occupied) < distance.size
    for cell in torch.randint(64, (200, 3), generator=generator):
        nearest = int((occupied - cell).abs().amax(-1).amin())
        assert distance[tuple(cell.tolist())] == min(nearest, 8)


def test_logits_are_those_before_softplus() -> None:
    logits = torch.linspace(-7, 23, 50)
    torch.testing.assert_close(logits_of(30 * torch.nn.functional.softplus(logits), 30.0), logits, rtol=0, atol=1e-2)
    assert logit_texels(logits_of(torch.tensor([0.0, 1e9]), 30.0)).tolist() == [0, 255]
