"""The biases of hypotheses and their derivatives: those of codes, or free ones around an object's.

A search moves along the principal directions of the codes. A free stage (:mod:`core.fitting.free`) moves the biases
themselves: shape and texture of its parameters are offsets from the biases of fixed codes, the *origin*, in standard
deviations of the biases over the training codes (:attr:`core.models.model.Model.bias_std`).
"""

import torch
from jaxtyping import Bool, Float, Float16
from torch import Tensor

from core.fitting.hypotheses import Parameters
from core.models.codes import Codes, CodeSpace
from core.models.latents import Latents
from core.models.model import Model
from core.rendering.jacobian import BiasJacobians
from core.rendering.shape_cells import shape_cells
from core.runtime.precision import matmul_dtype


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
        return [Codes(shape, texture) for shape, texture in pairs]
    return [
        Codes(
            origin.shape,
            origin.texture,
            _with_weights(shape.half(), origin.shape_offsets),
            _with_weights(texture.half(), origin.texture_offsets),
        )
        for shape, texture in zip(*_offsets(model, parameters), strict=True)
    ]


def _with_weights(
    biases: Float16[Tensor, "blocks width"], network: Float16[Tensor, "rows width"] | None
) -> Float16[Tensor, "rows_of_both width"]:
    """Return the offsets of biases, then those of weights from a network's."""
    return biases if network is None else torch.cat((biases, network[len(biases) :]))


def _offsets(
    model: Model, parameters: Parameters
) -> tuple[Float[Tensor, "hypotheses blocks width"], Float[Tensor, "hypotheses more_blocks width"]]:
    """Return the offsets of free hypotheses."""
    shape, texture = (
        offsets.unflatten(1, std.shape)
        for offsets, std in zip((parameters.shape, parameters.texture), model.bias_std, strict=True)
    )
    return shape, texture


def bias_jacobians(model: Model, parameters: Parameters, origin: Latents | None = None) -> BiasJacobians:
    """Return the derivatives of :func:`hypothesis_biases` with respect to the parameters of shape and texture."""
    dtype = matmul_dtype(model.device.type)
    if origin is None:
        shapes = model.codes.shape_space
        textures = model.codes.texture_space
        return BiasJacobians(
            model.field.shape_bias_jacobian(shapes.code(parameters.shape), shapes.basis).to(dtype),
            model.field.texture_bias_jacobian(textures.code(parameters.texture), textures.basis).to(dtype),
        )
    return BiasJacobians(*(std.expand(len(parameters.shape), -1, -1) for std in model.bias_std))


def hypothesis_cells(
    model: Model, parameters: Parameters, origin: Latents | None = None
) -> Bool[Tensor, "hypotheses x y z"] | None:
    """Return the cells that each hypothesis' shape may occupy (:func:`core.rendering.shape_cells.shape_cells`)."""
    return shape_cells(model, hypothesis_biases(model, parameters, origin)[0])
