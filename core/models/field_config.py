"""The size and the conventions of a field. Imports no torch, so that recipes load at once."""

from dataclasses import dataclass


@dataclass(frozen=True)
class FieldConfig:
    """The size and the conventions of a field. The defaults are the shipped models' sizes; the paper has others."""

    width: int = 96
    shape_blocks: int = 3
    texture_blocks: int = 1
    shape_latent: int = 64
    texture_latent: int = 32
    position_frequencies: int = 6
    direction_frequencies: int = 4
    density_scale: float = 30.0
    """Multiplies the softplus: an object is opaque within a hundredth of a scene unit, so the layer before it
    need not grow to hundreds. 1 in the authors' files."""
    bounded_colour: bool = True
    """A sigmoid on rgb. False in the authors' files, whose colours leave [0, 1]."""
    film: bool = False
    """Shape codes scale the shape blocks' outputs, beside shifting them: room that costs nothing per point."""
    architecture: str = "codenerf"
    """"M1" and "M2" are those of :mod:`core.models.ablations`."""

    def __post_init__(self) -> None:
        if self.architecture not in ("codenerf", "M1", "M2"):
            raise ValueError(f"no field has this architecture: {self.architecture}")
        sizes = (self.width, self.shape_latent, self.texture_latent, self.shape_blocks, self.texture_blocks)
        if min(sizes) < 1 or self.width % 2 or min(self.position_frequencies, self.direction_frequencies) < 0:
            raise ValueError(f"no field has these sizes: {self}")
