import pytest
import torch
from torch.nn import functional

from core.runtime.layers import linear_relu, pad_rows, relu_, relu_backward_


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
@pytest.mark.parametrize("points", [0, 1, 37, 512])
def test_linear_relu_is_a_linear_layer_and_a_relu(points: int, dtype: torch.dtype) -> None:
    generator = torch.Generator().manual_seed(points)
    values, weight, bias = (
        torch.randn(*size, generator=generator).to(dtype) for size in ((points, 33), (20, 33), (20,))
    )
    plain = functional.linear(values, weight, bias).relu()
    close = 1e-5 if dtype == torch.float32 else 0.1
    torch.testing.assert_close(linear_relu(values, weight, bias), plain, rtol=close, atol=close)


@pytest.mark.parametrize(("count", "padded_count"), [(0, 0), (1, 512), (512, 512), (700, 1024)])
@pytest.mark.parametrize("width", [(), (3,)])
def test_rows_are_padded_with_zeros(count: int, padded_count: int, width: tuple[int, ...]) -> None:
    rows = torch.arange(1, 1 + count).reshape(-1, *[1] * len(width)).expand(count, *width)
    padded = pad_rows(rows)
    assert padded.shape == (padded_count, *width)
    assert torch.equal(padded[:count], rows)
    assert not padded[count:].any()


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16, torch.float64])
def test_relu_on_integers_is_relu_on_floats(dtype: torch.dtype) -> None:
    values = torch.tensor([[-1.5, -0.0, 0.0, 1e-30, 2.5, -1e-30, torch.inf, -torch.inf, torch.nan]], dtype=dtype)
    gradient = torch.randn(3, 9, generator=torch.Generator().manual_seed(0)).to(dtype)
    plain = values.relu()
    active = values > 0
    torch.testing.assert_close(relu_(values), plain, rtol=0, atol=0, equal_nan=True)
    masked = relu_backward_(gradient.clone(), values)
    torch.testing.assert_close(masked[:, :8], (gradient * active)[:, :8], rtol=0, atol=0)  # of a NaN either will do
