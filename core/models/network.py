"""The network of an object: the category's or, with offsets of its weights, the object's own.

Offsets begin with those of the biases, which every fitted object has (:meth:`core.models.model.Model.biases`). The
offsets of the weights follow. The first and the last layer and the effect of the viewing direction stay the category's.
"""

import copy
from dataclasses import replace
from functools import lru_cache

import torch
from jaxtyping import Float16
from torch import Tensor

from core.models.field import Field
from core.models.latents import Latents
from core.models.model import Model
from core.runtime.modes import usual_settings


def has_network(model: Model, latents: Latents) -> bool:
    """Return True if an object of a model has its own network."""
    return _weight_offsets(model, latents) is not None


def with_network(model: Model, latents: Latents) -> Model:
    """Return the model that renders an object: a copy with the object's network, or the model itself."""
    offsets = _weight_offsets(model, latents)
    return model if offsets is None else _with_offsets(model, offsets)


def copy_field(field: Field) -> Field:
    """Return a copy of a field with its own weights; layers that no object owns are shared."""
    shared = field.point_layer, field.shape_latent, field.texture_latent
    return copy.deepcopy(field, {id(layer): layer for layer in shared})


def weight_offsets(
    field: Field, category: Field
) -> tuple[Float16[Tensor, "rows width"], Float16[Tensor, "more_rows width"]]:
    """Return the offsets of a field's weights from the category's: of the shape part and of the texture part."""
    shape, texture = (
        (torch.cat(weights) - torch.cat(origin)).detach().half()
        for weights, origin in (
            (field.shape_weights, category.shape_weights),
            (field.texture_weights, category.texture_weights),
        )
    )
    return shape, texture


def _weight_offsets(model: Model, latents: Latents) -> Latents | None:
    """Return the offsets of weights alone, as latents without codes, which are compared by value; None: zeros."""
    config = model.field.config
    pairs = (latents.shape_offsets, config.shape_blocks), (latents.texture_offsets, config.texture_blocks)
    shape, texture = (None if rows is None or len(rows) <= blocks else rows[blocks:] for rows, blocks in pairs)
    return None if shape is None and texture is None else Latents(torch.zeros(0), torch.zeros(0), shape, texture)


@lru_cache(maxsize=8)
def _with_offsets(model: Model, offsets: Latents) -> Model:
    """Return the model with offsets added to its weights; cached, as edits and codes do not change them."""
    with usual_settings(), torch.no_grad():
        field = copy_field(model.field)
        pairs = (field.shape_weights, offsets.shape_offsets), (field.texture_weights, offsets.texture_offsets)
        for weights, rows in pairs:
            if rows is not None:
                for weight, change in zip(weights, rows.split(list(map(len, weights))), strict=True):
                    weight += change.to(weight)
        return replace(model, field=field, stored_cells=model.occupied_cells)
