"""A field with one object's codes folded in."""

from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

from core.edits import kinds
from core.models.model import Instance
from core.models.network import with_network
from core.rendering.folded_layers import field_weights, folded_colour, folded_density
from core.rendering.outline import outline
from core.runtime.layers import relu_
from core.runtime.modes import usual_settings
from core.runtime.precision import matmul_dtype


class FoldedField:
    """Density and colour of one object in two steps, so that only visible points are coloured.

    Raises ``ValueError`` for M1 and M2 (:mod:`core.models.architecture_variants`).
    """

    def __init__(self, instance: Instance) -> None:
        model = instance.model
        network = with_network(model, instance.codes)
        self.field = network.field
        self.device = model.device
        self.dtype = matmul_dtype(model.device.type)
        self._weights = field_weights(network, self.dtype)
        self._edits = instance.codes.field_edits
        self._space_edits = instance.codes.space_edits
        self._sizes = tuple(edit for edit in self._edits if edit.subject == "size")
        self._outline = outline(instance)
        self._part_head = model.part_head
        with torch.no_grad():
            shape, texture = instance.biases
            self._shape = tuple(shape.to(self.dtype).unbind(-2))
            self._texture = tuple(texture.to(self.dtype).unbind(-2))

    @classmethod
    def of(cls, instance: Instance) -> "FoldedField":
        """Return the folded field of an object, cached: its renders, bakes and meshes share it."""
        return _folded(instance.unstretched, matmul_dtype(instance.model.device.type))

    def origins(self, points: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
        """Return the places in the natural object that points come from."""
        return kinds.origins(points, self._sizes)

    def first_layer(self, points: Float[Tensor, "points 3"]) -> Float[Tensor, "points width"]:
        """Return the activations of the first layer. Without edits of space they depend on no code."""
        return relu_(self._weights.position(kinds.origins(points, self._edits)))

    def density(
        self, points: Float[Tensor, "points 3"]
    ) -> tuple[Float[Tensor, "points"], Float[Tensor, "points width"]]:
        """Return density per scene unit, bounded by the outline of photos, and features for :meth:`colour`."""
        origins = kinds.origins(points, self._edits)
        density, features = self.unbounded_density(relu_(self._weights.position(origins)))
        if self._outline is None:
            return density, features
        # Unless the code has moved, too, they are also the places on the fitted object.
        is_fitted = self._outline.edits == self._space_edits
        return density * (self._outline.factor_at(origins) if is_fitted else self._outline.factor(points)), features

    def unbounded_density(
        self, first: Float[Tensor, "points width"]
    ) -> tuple[Float[Tensor, "points"], Float[Tensor, "points width"]]:
        """Return density and features like :meth:`density`, without the outline, from :meth:`first_layer`'s output."""
        density, features = folded_density(self.field, self._weights, first, self._shape)
        return kinds.densities(density, self._edits), features

    def direction_bias(self, directions: Float[Tensor, "rays 3"]) -> Float[Tensor, "rays width"]:
        """Return the viewing direction's contribution to the first texture layer."""
        return self._weights.direction(directions)

    def colour(
        self, features: Float[Tensor, "points width"], direction_bias: Float[Tensor, "points width"]
    ) -> Float[Tensor, "points 3"]:
        """Return rgb, edited, from :meth:`density`'s features and the bias of each point's viewing direction."""
        colours = folded_colour(self.field, self._weights, features, direction_bias, self._texture)
        head = self._part_head
        return kinds.colours(colours, self._edits, lambda: head.parts(features) if head else {})


@lru_cache(maxsize=8)
def _folded(instance: Instance, dtype: torch.dtype) -> FoldedField:
    """Return a folded field by everything that it depends on."""
    with usual_settings():  # cached
        return FoldedField(instance)


def clear_folded() -> None:
    """Clear the cached folded fields."""
    _folded.cache_clear()
