"""The biases of hypotheses and their derivatives: those of codes, or free ones around an object's.

A search moves along the principal directions of the codes. A free stage (:mod:`core.fitting.free`) moves the biases
themselves: shape and texture of its parameters are coordinates of offsets from the biases of fixed codes, the *origin*.
The coordinates are standard normal where offsets vary and correlate as biases do over the training codes, with a part
that is independent for each bias.
"""

from functools import lru_cache

import torch
from jaxtyping import Bool, Float, Float64
from torch import Tensor

from core.fitting.hypotheses import Parameters
from core.models.codes import Codes, CodeSpace
from core.models.latents import Latents
from core.models.model import Model
from core.rendering.jacobian import BiasJacobians
from core.rendering.shape_cells import shape_cells
from core.runtime.precision import matmul_dtype

_CORRELATED = 0.7  # fraction of an offset's variance that follows the training biases; with 0, fits are less steady


def hypothesis_biases(
    model: Model, parameters: Parameters, origin: Latents | None = None
) -> tuple[Float[Tensor, "hypotheses blocks width"], Float[Tensor, "hypotheses more_blocks width"]]:
    """Return the biases of the shape blocks and of the texture blocks.

    Args:
        origin: latents from whose biases the parameters lead away; None: the parameters are coordinates of codes.
    """
    if origin is None:
        spaces = model.codes.shape_space, model.codes.texture_space
        return model.field.biases(spaces[0].code(parameters.shape), spaces[1].code(parameters.texture))
    shape, texture = (
        bias + offsets.to(bias) * std
        for bias, offsets, std in zip(model.biases(origin), _offsets(model, parameters), model.bias_std, strict=True)
    )
    return shape, texture


def hypothesis_codes(
    model: Model, parameters: Parameters, spaces: tuple[CodeSpace, CodeSpace], origin: Latents | None = None
) -> list[Codes]:
    """Return the codes of hypotheses, with offsets if they are free.

    Args:
        spaces: of shape and texture.
        origin: see :func:`hypothesis_biases`.
    """
    if origin is None:
        pairs = zip(spaces[0].code(parameters.shape), spaces[1].code(parameters.texture), strict=True)
        return [Codes(shape, texture, model=model.fingerprint) for shape, texture in pairs]
    return [
        Codes(origin.shape, origin.texture, shape.half(), texture.half(), model=model.fingerprint)
        for shape, texture in zip(*_offsets(model, parameters), strict=True)
    ]


def _offsets(
    model: Model, parameters: Parameters
) -> tuple[Float[Tensor, "hypotheses blocks width"], Float[Tensor, "hypotheses more_blocks width"]]:
    """Return the offsets of free hypotheses, in standard deviations of the training biases."""
    shape, texture = (
        (coordinates @ factor.T).unflatten(1, std.shape)
        for coordinates, factor, std in zip(
            (parameters.shape, parameters.texture), _factors(model), model.bias_std, strict=True
        )
    )
    return shape, texture


def bias_jacobians(model: Model, parameters: Parameters, origin: Latents | None = None) -> BiasJacobians:
    """Return the derivatives of :func:`hypothesis_biases` with respect to the parameters of shape and texture."""
    dtype = matmul_dtype(model.device.type)
    if origin is None:
        shapes, textures = model.codes.shape_space, model.codes.texture_space
        return BiasJacobians(
            model.field.shape_bias_jacobian(shapes.code(parameters.shape), shapes.basis).to(dtype),
            model.field.texture_bias_jacobian(textures.code(parameters.texture), textures.basis).to(dtype),
        )
    shape, texture = (
        (std.flatten()[:, None] * factor).unflatten(0, std.shape).to(dtype).expand(len(parameters.shape), -1, -1, -1)
        for std, factor in zip(model.bias_std, _factors(model), strict=True)
    )
    return BiasJacobians(shape, texture)


def hypothesis_cells(
    model: Model, parameters: Parameters, origin: Latents | None = None
) -> Bool[Tensor, "hypotheses x y z"] | None:
    """Return the cells that each hypothesis' shape may occupy (:func:`core.rendering.shape_cells.shape_cells`)."""
    return shape_cells(model, hypothesis_biases(model, parameters, origin)[0])


@lru_cache(maxsize=2)
def _factors(model: Model) -> tuple[Float[Tensor, "shape_biases shape_biases"], Float[Tensor, "biases biases"]]:
    """Return triangular matrices from standard normal coordinates to offsets of shape and texture."""
    with torch.inference_mode(False), torch.no_grad():  # cached
        biases = model.field.biases(model.codes.shapes, model.codes.textures)
        shape, texture = (
            _factor(((bias - bias.mean(0)) / std).flatten(1).double())
            for bias, std in zip(biases, model.bias_std, strict=True)
        )
        return shape, texture


def _factor(offsets: Float64[Tensor, "rows biases"]) -> Float[Tensor, "biases biases"]:
    """Return the Cholesky factor of the covariance of training offsets, shrunk towards independence."""
    covariance = offsets.T @ offsets / len(offsets)
    return torch.linalg.cholesky(torch.eye(len(covariance)).to(covariance).lerp(covariance, _CORRELATED)).float()
