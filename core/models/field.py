"""The conditional radiance field: one MLP for a whole category (Eqs. 1 and 2 and the architecture figure).

Density depends on a point and a shape code alone; colour depends on the resulting features, the viewing direction and a
texture code. The two signatures guarantee that texture cannot change density.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from core.models.density import logits_to_density
from core.models.field_config import FieldConfig
from core.models.latents import Latents


def encode(values: Float[Tensor, "*batch 3"], frequencies: int) -> Float[Tensor, "*batch encoded"]:
    """Apply the positional encoding :math:`\\gamma`: 3 + 6 * frequencies numbers per point.

    The values, then all sines, then all cosines of :math:`2^k x`, each block frequency by frequency with three axes. As
    in the authors' code, there is no factor pi.
    """
    scales = 2.0 ** torch.arange(frequencies, device=values.device, dtype=values.dtype)
    angles = (values[..., None, :] * scales[:, None]).flatten(-2)
    return torch.cat((values, angles.sin(), angles.cos()), -1)


class Field(nn.Module):
    """The network: a shape part ends in density and features, a texture part turns the features into colour.

    A code z enters in front of every block, through a latent layer of its own (linear, then ReLU), whose output is
    added to the features: ``block(y + latent(z))``. The block begins with a linear map, so the code amounts to another
    bias, ``W (y + latent(z)) + b = W y + (W latent(z) + b)``, the same for all points of an object. Computing this bias
    once per code (:meth:`shape_bias`, :meth:`texture_bias`) is exact: codes of any size cost nothing per point.
    """

    def __init__(self, config: FieldConfig) -> None:
        super().__init__()
        width = config.width
        self.config = config
        self.point_layer = nn.Linear(3 + 6 * config.position_frequencies, width)
        self.shape_latent = nn.ModuleList(nn.Linear(config.shape_latent, width) for _ in range(config.shape_blocks))
        self.shape_block = nn.ModuleList(nn.Linear(width, width) for _ in range(config.shape_blocks))
        self.feature_layer = nn.Linear(width, width)
        self.density_layer = nn.Linear(width, 1)
        self.direction_layer = nn.Linear(width + 3 + 6 * config.direction_frequencies, width)
        self.texture_latent = nn.ModuleList(
            nn.Linear(config.texture_latent, width) for _ in range(config.texture_blocks)
        )
        self.texture_block = nn.ModuleList(nn.Linear(width, width) for _ in range(config.texture_blocks))
        self.colour_hidden = nn.Linear(width, width // 2)
        self.colour_layer = nn.Linear(width // 2, 3)

    def shape_bias(self, shape: Float[Tensor, "*batch latent"]) -> Float[Tensor, "*batch blocks width"]:
        """Return the biases of the shape blocks with a shape code folded in."""
        return folded_biases(self.shape_latent, self.shape_block, shape)

    def texture_bias(self, texture: Float[Tensor, "*batch latent"]) -> Float[Tensor, "*batch blocks width"]:
        """Return the biases of the texture blocks with a texture code folded in."""
        return folded_biases(self.texture_latent, self.texture_block, texture)

    def shape_bias_jacobian(
        self, shape: Float[Tensor, "*batch latent"], directions: Float[Tensor, "directions latent"]
    ) -> Float[Tensor, "*batch blocks width directions"]:
        """Return the jacobian of :meth:`shape_bias` along directions of the code."""
        return _folded_bias_jacobian(self.shape_latent, self.shape_block, shape, directions)

    def texture_bias_jacobian(
        self, texture: Float[Tensor, "*batch latent"], directions: Float[Tensor, "directions latent"]
    ) -> Float[Tensor, "*batch blocks width directions"]:
        """Return the jacobian of :meth:`texture_bias` along directions of the code."""
        return _folded_bias_jacobian(self.texture_latent, self.texture_block, texture, directions)

    def biases(
        self, shape: Float[Tensor, "*batch shape_latent"], texture: Float[Tensor, "*batch texture_latent"]
    ) -> tuple[Float[Tensor, "*batch blocks width"], Float[Tensor, "*batch more_blocks width"]]:
        """Return the biases of the shape blocks and of the texture blocks."""
        return self.shape_bias(shape), self.texture_bias(texture)

    @property
    def shape_weights(self) -> tuple[Float[Tensor, "_ width"], ...]:
        """The weights of the shape part that an object may own: views, in the order of its offsets.

        The first layer is left out: renderers share its activations. Biases of the blocks have offsets of their own.
        """
        feature = self.feature_layer
        return *_matrices(self.shape_block), feature.weight, feature.bias[None], self.density_layer.weight

    @property
    def texture_weights(self) -> tuple[Float[Tensor, "_ width"], ...]:
        """The weights of the texture part, as :attr:`shape_weights`.

        Those of the viewing direction are left out, as few photos do not show how colours depend on it, and so is the
        last layer, whose rows are shorter.
        """
        entry = self.direction_layer
        blocks = _matrices(self.texture_block)
        return entry.weight[:, : self.config.width], entry.bias[None], *blocks, self.colour_hidden.weight

    def fits(self, latents: Latents) -> bool:
        """Return whether codes and offsets have the sizes of this field."""
        config = self.config
        if latents.shape.shape != (config.shape_latent,) or latents.texture.shape != (config.texture_latent,):
            return False
        sizes = (
            (latents.shape_offsets, config.shape_blocks, self.shape_weights),
            (latents.texture_offsets, config.texture_blocks, self.texture_weights),
        )
        return all(
            offsets is None
            or (offsets.shape[1] == config.width and len(offsets) in (blocks, blocks + sum(map(len, weights))))
            for offsets, blocks, weights in sizes
        )

    def radiance(
        self,
        points: Float[Tensor, "*batch 3"],
        direction_bias: Float[Tensor, "*#batch width"],
        shape_bias: Float[Tensor, "*#batch blocks width"],
        texture_bias: Float[Tensor, "*#batch more_blocks width"],
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch 3"]]:
        """Return density per scene unit and rgb: :meth:`density`, then :meth:`colour`."""
        density, features = self.density(points, shape_bias)
        return density, self.colour(features, direction_bias, texture_bias)

    def density(
        self, points: Float[Tensor, "*batch 3"], shape_bias: Float[Tensor, "*#batch blocks width"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch width"]]:
        """Evaluate Eq. 2's :math:`F^s`: density per scene unit, and features for the texture part.

        Args:
            points: world, within the scene's box.
            shape_bias: from :meth:`shape_bias`; broadcast over the points.
        """
        return self.density_from_activations(
            self.point_layer(encode(points, self.config.position_frequencies)).relu(), shape_bias
        )

    def density_from_activations(
        self, y: Float[Tensor, "*batch width"], shape_bias: Float[Tensor, "*#batch blocks width"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch width"]]:
        """Evaluate :meth:`density` from the activations of the first layer, which depend on no code."""
        logit, features = self.logits_from_activations(y, shape_bias)
        return logits_to_density(logit, self.config), features

    def logits_from_activations(
        self, y: Float[Tensor, "*batch width"], shape_bias: Float[Tensor, "*#batch blocks width"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch width"]]:
        """Return logits of the density, and features, from the activations of the first layer."""
        features = self.feature_layer(self._shape_activations(y, shape_bias))
        return self.density_layer(features)[..., 0].float(), features

    def activations(
        self, points: Float[Tensor, "*batch 3"], shape_bias: Float[Tensor, "*#batch blocks width"]
    ) -> Float[Tensor, "*batch width"]:
        """Return the activations that features are linear in, as part heads take them; arguments as :meth:`density`."""
        first = self.point_layer(encode(points, self.config.position_frequencies)).relu()
        return self._shape_activations(first, shape_bias)

    def _shape_activations(
        self, y: Float[Tensor, "*batch width"], shape_bias: Float[Tensor, "*#batch blocks width"]
    ) -> Float[Tensor, "*batch width"]:
        for weight, bias in zip(_matrices(self.shape_block), shape_bias.unbind(-2), strict=True):
            y = (functional.linear(y, weight) + bias.to(y.dtype)).relu()
        return y

    def direction_bias(self, directions: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch width"]:
        """Return the direction's contribution to the texture part's first layer, including that layer's bias.

        Args:
            directions: world, unit length; one per ray is enough.
        """
        weight = self.direction_layer.weight[:, self.config.width :]
        return functional.linear(
            encode(directions, self.config.direction_frequencies), weight, self.direction_layer.bias
        )

    def colour(
        self,
        features: Float[Tensor, "*batch width"],
        direction_bias: Float[Tensor, "*#batch width"],
        texture_bias: Float[Tensor, "*#batch blocks width"],
    ) -> Float[Tensor, "*batch 3"]:
        """Evaluate Eq. 2's :math:`F^t`: rgb, in [0, 1] if ``bounded_colour``.

        Args:
            features: from :meth:`density`.
            direction_bias: from :meth:`direction_bias`; broadcast over the samples of a ray.
            texture_bias: from :meth:`texture_bias`; broadcast over the points of an object.
        """
        y = functional.linear(features, self.direction_layer.weight[:, : self.config.width])
        y = (y + direction_bias.to(y.dtype)).relu()
        for weight, bias in zip(_matrices(self.texture_block), texture_bias.unbind(-2), strict=True):
            y = (functional.linear(y, weight) + bias.to(y.dtype)).relu()
        logits = self.colour_layer(self.colour_hidden(y).relu()).float()
        return logits.sigmoid() if self.config.bounded_colour else logits


def _matrices(blocks: nn.ModuleList) -> list[Tensor]:
    return [block.get_parameter("weight") for block in blocks]


def folded_biases(
    latent: nn.ModuleList, blocks: nn.ModuleList, code: Float[Tensor, "*batch latent"]
) -> Float[Tensor, "*batch blocks width"]:
    """Return the biases of blocks with a code folded in (:class:`Field`); the code may be on any device."""
    code = code.to(blocks[0].get_parameter("weight").device)
    biases = [block(layer(code).relu()) for layer, block in zip(latent, blocks, strict=True)]
    return torch.stack(biases, -2).float()


def _folded_bias_jacobian(
    latent: nn.ModuleList,
    blocks: nn.ModuleList,
    code: Float[Tensor, "*batch latent"],
    directions: Float[Tensor, "directions latent"],
) -> Float[Tensor, "*batch blocks width directions"]:
    """Return the jacobian of :func:`folded_biases`: the block's matrix times the active rows of the latent layer's."""
    device = blocks[0].get_parameter("weight").device
    code = code.to(device)
    directions = directions.to(device)
    jacobians = []
    for layer, weight in zip(latent, _matrices(blocks), strict=True):
        active = layer(code) > 0
        jacobians.append(weight @ (active[..., None] * (layer.get_parameter("weight") @ directions.T)))
    return torch.stack(jacobians, -3).float()
