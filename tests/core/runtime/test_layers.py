import pytest
import torch
from torch.nn import functional

from core.runtime.layers import linear_relu, pad_rows, relu_, relu_backward_


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
@pytest.mark.parametrize("points", [0, 1, 37, 512])
def test_it_is_a_linear_layer_and_its_rectifier(points: int, dtype: torch.dtype) -> None:
    generator = torch.Generator().manual_seed(points)
    values, weight, bias = (
        torch.randn(*size, generator=generator).to(dtype) for size in ((points, 33), (20, 33), (20,))
    )
    plain = functional.linear(values, weight, bias).relu()
    close = 1e-5 if dtype == torch.float32 else 0.1
    torch.testing.assert_close(linear_relu(values, weight, bias), plain, rtol=close, atol=close)


@pytest.mark.parametrize(("count", "more"), [(0, 0), (1, 512), (512, 512), (700, 1024)])
@pytest.mark.parametrize("width", [(), (3,)])
def test_rows_are_filled_up_with_zeros(count: int, more: int, width: tuple[int, ...]) -> None:
    rows = torch.arange(1, 1 + count).reshape(-1, *[1] * len(width)).expand(count, *width)
    found = pad_rows(rows)
    assert found.shape == (more, *width)
    assert torch.equal(found[:count], rows)
    assert not found[count:].any()


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16, torch.float64])
def test_rectifying_integers_rectifies_floats(dtype: torch.dtype) -> None:
    values = torch.tensor([[-1.5, -0.0, 0.0, 1e-30, 2.5, -1e-30, torch.inf, -torch.inf, torch.nan]], dtype=dtype)
    gradient = torch.randn(3, 9, generator=torch.Generator().manual_seed(0)).to(dtype)
    plain, active = values.relu(), values > 0
    torch.testing.assert_close(relu_(values), plain, rtol=0, atol=0, equal_nan=True)
    held = relu_backward_(gradient.clone(), values)
    torch.testing.assert_close(held[:, :8], (gradient * active)[:, :8], rtol=0, atol=0)  # of a NaN either will do
