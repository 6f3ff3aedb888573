"""The layers of a field with codes folded in, for rendering without gradients: the same function in fewer operations.

Three simplifications:

* A code's contribution to a block is a bias (see :class:`core.models.field.Field`), computed once per code.
* The feature layer is linear and followed by two other layers, so it is multiplied into both.
* The positional encoding treats each axis separately, and the first layer is linear in it. So the layer's output is a
  function of x, plus one of y, plus one of z: three lookup tables. Only this one is not exact.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional

from core.models.cells import contains
from core.models.density import logits_to_density
from core.models.field import Field, encode
from core.models.model import Model
from core.runtime.layers import chunk_points, linear_relu, pad_rows, relu_
from core.runtime.pool import map_pieces
from core.runtime.precision import matmul_dtype

_RESOLUTION = 8192  # entries along each axis
_MARGIN = 1.1  # size of the position table relative to the scene's box: samples may lie slightly outside the box


class AxisLookup(NamedTuple):
    """A linear layer on a positional encoding, as a table: a function of x, plus one of y, plus one of z."""

    scale: Float[Tensor, "3"]  # entries per unit along each axis
    origin_index: Float[Tensor, "3"]  # index of value 0 on each axis
    first: Float[Tensor, "3"]  # first index of each axis
    last: Float[Tensor, "3"]  # last index of each axis
    entries: Float[Tensor, "entries outputs"]  # for x, then y, then z; those for x include the bias
    frequencies: int
    layer: tuple[Tensor, Tensor]  # weight and bias, for encoded values

    @classmethod
    def from_layer(
        cls, frequencies: int, weight: Tensor, bias: Tensor, reach: Float[Tensor, "3"], dtype: torch.dtype
    ) -> "AxisLookup":
        """Tabulate a layer over [-reach, reach] of each axis; an entry is exact at the middle of its interval."""
        positions = ((torch.arange(_RESOLUTION, device=reach.device) + 0.5) * (2 / _RESOLUTION) - 1)[:, None] * reach
        origin = encode(torch.zeros_like(reach), frequencies)
        encoded = encode(torch.diag_embed(positions).movedim(1, 0), frequencies) - origin  # axes, entries, encoded
        outputs = functional.linear(encoded, weight)
        outputs[0] += functional.linear(origin, weight, bias)
        first = torch.arange(3.0, device=reach.device) * _RESOLUTION
        where = _RESOLUTION / (2 * reach), first + _RESOLUTION / 2, first, first + (_RESOLUTION - 1)
        return cls(*where, outputs.flatten(0, 1).to(dtype), frequencies, (weight.to(dtype), bias.to(dtype)))

    def __call__(self, values: Float[Tensor, "values 3"]) -> Float[Tensor, "values outputs"]:
        """Look up the layer's output; values outside the table get its nearest entry."""
        entry = torch.addcmul(self.origin_index, values, self.scale).nan_to_num_(0.0)
        entry = entry.clamp_(self.first, self.last).int()
        return functional.embedding_bag(entry, self.entries, mode="sum")

    def evaluate(self, values: Float[Tensor, "values 3"]) -> Float[Tensor, "values outputs"]:
        """Compute the layer's output exactly, also outside the table."""
        weight, bias = self.layer
        return functional.linear(encode(values, self.frequencies).to(weight.dtype), weight, bias)


class FieldWeights(NamedTuple):
    """The weights, which no code changes, in the number format that this machine multiplies fastest."""

    position: AxisLookup
    shape_blocks: tuple[Tensor, ...]
    density: tuple[Tensor, Tensor]
    features: Tensor
    direction: AxisLookup
    texture_blocks: tuple[Tensor, ...]
    hidden: tuple[Tensor, Tensor]
    rgb: tuple[Tensor, Tensor]


@torch.no_grad()
def batch_density(
    model: Model,
    points: Float[Tensor, "objects points 3"],
    shape_bias: Float[Tensor, "objects blocks width"],
    cells: Bool[Tensor, "#objects x y z"] | None = None,
) -> Float[Tensor, "objects points"]:
    """Return the density per scene unit of many objects, each at its own points; not differentiable.

    Args:
        cells: occupied cells (:mod:`core.models.occupied_cells`), outside which the density is 0; None: everywhere.
    """
    weights = field_weights(model, matmul_dtype(model.device.type))
    biases = shape_bias.to(weights.features.dtype).unbind(0)
    # A network that paints the background is evaluated outside the box, too.
    first = weights.position.evaluate if model.white_from_network else weights.position
    densities = torch.zeros(points.shape[:-1], device=points.device)
    if cells is None:
        inside = torch.ones_like(densities, dtype=torch.bool)
    else:
        inside = contains(cells, points, model.extent_tensor)

    def evaluate(piece: tuple[int, Int[Tensor, "_"]]) -> Float[Tensor, "_"]:
        number, index = piece
        y = relu_(first(pad_rows(points[number].index_select(0, index))))
        return folded_density(model.field, weights, y, biases[number].unbind(0))[0][: len(index)]

    chunk = chunk_points(weights.features.dtype)
    pieces = [(number, index) for number, mask in enumerate(inside) for index in mask.nonzero()[:, 0].split(chunk)]
    for (number, index), density in zip(pieces, map_pieces(evaluate, pieces), strict=True):
        densities[number].index_copy_(0, index, density)
    return densities


@torch.no_grad()
def batch_colour(
    model: Model,
    points: Float[Tensor, "objects points 3"],
    directions: Float[Tensor, "objects points 3"],
    shape_bias: Float[Tensor, "objects blocks width"],
    texture_bias: Float[Tensor, "objects more_blocks width"],
) -> Float[Tensor, "objects points 3"]:
    """Return rgb of many objects, each at its own points and viewing directions; not differentiable."""
    weights = field_weights(model, matmul_dtype(model.device.type))
    dtype = weights.features.dtype
    first = weights.position.evaluate if model.white_from_network else weights.position
    colours = []
    chunk = chunk_points(dtype)
    objects = zip(points, directions, shape_bias.to(dtype), texture_bias.to(dtype), strict=True)
    for positions, viewing, *biases in objects:
        shape, texture = (bias.unbind(0) for bias in biases)
        for position, direction in zip(positions.split(chunk), viewing.split(chunk), strict=True):
            y = _features(weights, relu_(first(position)), shape)
            colours.append(folded_colour(model.field, weights, y, weights.direction(direction), texture))
    return torch.cat(colours).reshape(points.shape)


def _features(
    weights: FieldWeights, y: Float[Tensor, "points width"], biases: Sequence[Float[Tensor, "width"]]
) -> Float[Tensor, "points width"]:
    for weight, bias in zip(weights.shape_blocks, biases, strict=True):
        y = linear_relu(y, weight, bias)
    return y


def folded_density(
    field: Field, weights: FieldWeights, y: Float[Tensor, "points width"], biases: Sequence[Float[Tensor, "width"]]
) -> tuple[Float[Tensor, "points"], Float[Tensor, "points width"]]:
    """Return density per scene unit and features for :func:`folded_colour`.

    Args:
        y: activations of the first layer.
        biases: of the shape blocks.
    """
    y = _features(weights, y, biases)
    logit = functional.linear(y, *weights.density)[:, 0].float()
    return logits_to_density(logit, field.config), y


def folded_colour(
    field: Field,
    weights: FieldWeights,
    y: Float[Tensor, "points width"],
    direction_bias: Float[Tensor, "#points width"],
    biases: Sequence[Float[Tensor, "width"]],
) -> Float[Tensor, "points 3"]:
    """Return rgb from the features of :func:`folded_density`.

    Args:
        direction_bias: contribution of the viewing direction.
        biases: of the texture blocks.
    """
    y = relu_(functional.linear(y, weights.features).add_(direction_bias))
    for weight, bias in zip(weights.texture_blocks, biases, strict=True):
        y = linear_relu(y, weight, bias)
    y = linear_relu(y, *weights.hidden)
    logits = functional.linear(y, *weights.rgb).float()
    return logits.sigmoid() if field.config.bounded_colour else logits


def field_weights(model: Model, dtype: torch.dtype) -> FieldWeights:
    """Return the weights of a model's field, cached. Raises ``ValueError`` for M1 and M2."""
    return _field_weights(model.soft, dtype)  # contrast changes no weights


@lru_cache(maxsize=4)
@torch.no_grad()
def _field_weights(model: Model, dtype: torch.dtype) -> FieldWeights:
    field: Field = model.field
    if model.is_ablation:
        raise ValueError(f"a model of architecture {field.config.architecture} needs --exact and cannot be fitted")
    width = field.config.width
    features = field.feature_layer
    entry = field.direction_layer
    from_features = entry.weight[:, :width]

    def cast(tensor: Tensor) -> Tensor:
        return tensor.detach().to(dtype).contiguous()

    def layer(name: str) -> tuple[Tensor, Tensor]:
        return cast(field.get_parameter(f"{name}.weight")), cast(field.get_parameter(f"{name}.bias"))

    sigma = field.density_layer
    view = entry.weight[:, width:], from_features @ features.bias + entry.bias
    reach = torch.ones_like(model.extent_tensor)
    return FieldWeights(
        position=_position_table(field.point_layer, field.config.position_frequencies, model.extent, dtype),
        shape_blocks=tuple(layer(f"shape_block.{index}")[0] for index in range(field.config.shape_blocks)),
        density=(cast(sigma.weight @ features.weight), cast(sigma.weight @ features.bias + sigma.bias)),
        features=cast(from_features @ features.weight),
        direction=AxisLookup.from_layer(field.config.direction_frequencies, *view, reach, dtype),
        texture_blocks=tuple(layer(f"texture_block.{index}")[0] for index in range(field.config.texture_blocks)),
        hidden=layer("colour_hidden"),
        rgb=layer("colour_layer"),
    )


@lru_cache(maxsize=4)
@torch.no_grad()
def _position_table(
    layer: torch.nn.Linear, frequencies: int, extent: tuple[float, float, float], dtype: torch.dtype
) -> AxisLookup:
    """Return the table of a field's first layer, which the networks of a category's objects share."""
    reach = _MARGIN * torch.tensor(extent, device=layer.weight.device)
    return AxisLookup.from_layer(frequencies, layer.weight, layer.bias, reach, dtype)
