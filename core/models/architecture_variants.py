"""M1 and M2, the two other architectures of the paper's figure on disentanglement.

Each gives up one of the two signatures that keep shape, texture and viewpoint apart. Training and the exact renderer
support them; the fast renderer and fitting rely on those signatures and do not.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from core.models.field import Field, encode, folded_biases
from core.models.field_config import FieldConfig


def build_field(config: FieldConfig) -> Field:
    """Return an untrained field of the configured architecture and size."""
    return {"codenerf": Field, "M1": ViewDependentDensity, "M2": SharedEmbedding}[config.architecture](config)


class ViewDependentDensity(Field):
    """M1: the viewing direction enters the first layer of the shape part beside the point, and not the texture part."""

    def __init__(self, config: FieldConfig) -> None:
        super().__init__(config)
        self.early_direction = nn.Linear(3 + 6 * config.direction_frequencies, config.width, bias=False)

    def direction_bias(self, directions: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch width"]:
        """Return the direction's contribution to the first layer."""
        return self.early_direction(encode(directions, self.config.direction_frequencies))

    def density(
        self, points: Float[Tensor, "*batch 3"], shape_bias: Float[Tensor, "*#batch blocks width"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch width"]]:
        """Evaluate :meth:`core.models.field.Field.density` as seen from outside, towards the middle of the scene."""
        return self._density_towards(points, self.direction_bias(-functional.normalize(points, dim=-1)), shape_bias)

    def radiance(
        self,
        points: Float[Tensor, "*batch 3"],
        direction_bias: Float[Tensor, "*#batch width"],
        shape_bias: Float[Tensor, "*#batch blocks width"],
        texture_bias: Float[Tensor, "*#batch more_blocks width"],
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch 3"]]:
        """Evaluate :meth:`core.models.field.Field.radiance` with a density that depends on the direction."""
        density, features = self._density_towards(points, direction_bias, shape_bias)
        return density, self.colour(features, self.direction_layer.bias, texture_bias)

    def _density_towards(
        self,
        points: Float[Tensor, "*batch 3"],
        direction_bias: Float[Tensor, "*#batch width"],
        shape_bias: Float[Tensor, "*#batch blocks width"],
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch width"]]:
        first = self.point_layer(encode(points, self.config.position_frequencies))
        return self.density_from_activations((first + direction_bias.to(first.dtype)).relu(), shape_bias)


class SharedEmbedding(Field):
    """M2: both codes enter the shape part and neither the texture part, which amounts to a single embedding."""

    def __init__(self, config: FieldConfig) -> None:
        super().__init__(config)
        both = config.shape_latent + config.texture_latent
        self.shape_latent = nn.ModuleList(nn.Linear(both, config.width) for _ in range(config.shape_blocks))
        self.texture_latent = nn.ModuleList()

    def biases(
        self, shape: Float[Tensor, "*batch shape_latent"], texture: Float[Tensor, "*batch texture_latent"]
    ) -> tuple[Float[Tensor, "*batch blocks width"], Float[Tensor, "*batch more_blocks width"]]:
        """Return :meth:`core.models.field.Field.biases`; the texture blocks have only their own biases."""
        own = torch.stack([block.get_parameter("bias") for block in self.texture_block])
        both = torch.cat((shape, texture), -1)
        return folded_biases(self.shape_latent, self.shape_block, both), own.expand(*both.shape[:-1], *own.shape)
