import pytest
import torch

from core.runtime.precision import autocast, matmul_dtype, use_dtype


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_linear_layers_run_in_the_chosen_format_and_nothing_else_does(dtype: torch.dtype):
    with use_dtype(dtype), autocast(torch.device("cpu")):
        values = torch.ones(4, 8)
        assert torch.nn.Linear(8, 8)(values).dtype == matmul_dtype("cpu") == dtype
        assert values.exp().dtype == torch.float32
