import pytest
import torch
from torch import Tensor

from core.models.density import density_derivative, density_to_logits, logits_to_density, without_contrast
from core.models.field_config import FieldConfig

CONFIGS = [FieldConfig(), FieldConfig(contrast=20.0), FieldConfig(contrast=5.0, contrast_gain=1.5, density_scale=1.0)]


def plain(logit: float, config: FieldConfig) -> float:
    soft = config.density_scale * float(torch.tensor(logit).double().exp().log1p())
    return soft * min(soft / config.contrast, config.contrast_gain) if config.contrast else soft


@pytest.mark.parametrize("config", CONFIGS)
def test_density_is_the_formula_grows_and_has_its_derivative(config: FieldConfig) -> None:
    logits = torch.linspace(-12, 12, 97)
    expected = torch.tensor([plain(float(logit), config) for logit in logits])
    torch.testing.assert_close(logits_to_density(logits, config), expected, rtol=1e-4, atol=1e-7)
    assert bool((logits_to_density(torch.linspace(-15, 20, 500), config).diff() > 0).all())
    logits = torch.linspace(-9, 15, 83, requires_grad=True)
    density = logits_to_density(logits, config)
    (expected,) = torch.autograd.grad(density.sum(), logits)
    torch.testing.assert_close(density_derivative(density.detach(), config), expected, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("config", CONFIGS)
def test_logits_and_soft_densities_survive_conversion(config: FieldConfig) -> None:
    logits = torch.linspace(-7, 23, 50)
    density = logits_to_density(logits, config)
    torch.testing.assert_close(density_to_logits(density, config), logits, rtol=0, atol=1e-2)
    soft = config.density_scale * torch.nn.functional.softplus(logits)
    torch.testing.assert_close(without_contrast(density, config), soft, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("config", CONFIGS)
@pytest.mark.parametrize("value", [0.0, 1e-30, 1e10, 1e30])
def test_extreme_densities_have_finite_logits(config: FieldConfig, value: float) -> None:
    logits: Tensor = density_to_logits(torch.tensor([value]), config)
    assert bool(torch.isfinite(logits).all())


@pytest.mark.parametrize("wrong", [{"contrast": -1.0}, {"contrast": float("nan")}, {"contrast_gain": 0.5}])
def test_impossible_contrast_is_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match="contrast"):
        FieldConfig(**wrong)
