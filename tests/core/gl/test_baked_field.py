import torch

from core.gl.baked_field import cell_distances, logit_texels
from core.models.density import density_to_logits
from core.models.field_config import FieldConfig


def test_distances_are_those_to_the_nearest_cell_and_texels_span_a_byte() -> None:
    generator = torch.Generator().manual_seed(0)
    cells = torch.rand(64, 64, 64, generator=generator) < 2e-4
    distance = cell_distances(cells).astype(int)
    occupied = cells.nonzero()
    assert 0 < len(occupied) < distance.size
    for cell in torch.randint(64, (200, 3), generator=generator):
        nearest = int((occupied - cell).abs().amax(-1).amin())
        assert distance[tuple(cell.tolist())] == min(nearest, 8)
    config = FieldConfig()
    assert logit_texels(density_to_logits(torch.tensor([0.0, 1e9]), config)).tolist() == [0, 255]
