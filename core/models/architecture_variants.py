"""M1 and M2, the two ablated architectures in the paper's figure on disentanglement.

In :class:`core.models.field.Field`, density does not depend on the viewing direction (M1 breaks this) and colour has
its own code (M2 breaks this). Training and the exact renderer support M1 and M2. The fast renderer and fitting do not.
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
    """M1: the viewing direction enters the first layer of the shape part, and no longer the texture part."""

    def __init__(self, config: FieldConfig) -> None:
        super().__init__(config)
        self.early_direction = nn.Linear(3 + 6 * config.direction_frequencies, config.width, bias=False)

    def direction_bias(self, directions: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch width"]:
        """Return the contribution of unit viewing directions to the first layer, without that layer's bias."""
        return self.early_direction(encode(directions, self.config.direction_frequencies))

    def density(
        self, points: Float[Tensor, "*batch 3"], shape_bias: Float[Tensor, "*#batch blocks width"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch width"]]:
        """Evaluate :meth:`core.models.field.Field.density`, each point seen along its ray to the scene's origin."""
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
    """M2: both codes enter the shape part, as one embedding; the texture part has no code."""

    def __init__(self, config: FieldConfig) -> None:
        super().__init__(config)
        both = config.shape_latent + config.texture_latent
        self.shape_latent = nn.ModuleList(nn.Linear(both, config.width) for _ in range(config.shape_blocks))
        self.texture_latent = nn.ModuleList()

    def biases(
        self, shape: Float[Tensor, "*batch shape_latent"], texture: Float[Tensor, "*batch texture_latent"]
    ) -> tuple[Float[Tensor, "*batch blocks width"], Float[Tensor, "*batch more_blocks width"]]:
        """Return :meth:`core.models.field.Field.biases`; those of the texture blocks are independent of the codes."""
        biases = torch.stack([block.get_parameter("bias") for block in self.texture_block])
        both = torch.cat((shape, texture), -1)
        return folded_biases(self.shape_latent, self.shape_block, both), biases.expand(*both.shape[:-1], *biases.shape)
