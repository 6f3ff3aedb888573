import torch

from core.models.precision import autocast, matmul_dtype


def test_linear_layers_run_in_the_measured_format_and_nothing_else_does():
    dtype = matmul_dtype("cpu")
    assert dtype in (torch.float32, torch.bfloat16)
    with autocast(torch.device("cpu")):
        values = torch.ones(4, 8)
        assert torch.nn.Linear(8, 8)(values).dtype == dtype
        assert values.exp().dtype == torch.float32
