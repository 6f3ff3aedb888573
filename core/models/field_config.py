"""The size and the conventions of a field. The module does not import torch, so training recipes load at once."""

from dataclasses import dataclass

from core.runtime.numbers import number, whole

_SIZES = {
    "width": (2, 1024),
    "shape_blocks": (1, 32),
    "texture_blocks": (1, 32),
    "shape_latent": (1, 4096),
    "texture_latent": (1, 4096),
    "position_frequencies": (0, 32),
    "direction_frequencies": (0, 32),
}  # least and greatest values, checked because a file's field is built before its weights are read


@dataclass(frozen=True)
class FieldConfig:
    """The size and the conventions of a field. Raises ``ValueError`` for values out of range.

    The defaults are those of the shipped models, not the paper's.
    """

    width: int = 96
    shape_blocks: int = 3
    texture_blocks: int = 1
    shape_latent: int = 64
    texture_latent: int = 32
    position_frequencies: int = 6
    direction_frequencies: int = 4
    density_scale: float = 30.0
    """At 30 an object is opaque within 0.01 scene units, so logits stay small. 1 in the authors' files."""
    contrast: float = 0.0  # density (per scene unit) that contrast leaves unchanged; 0: no contrast (density.py)
    contrast_gain: float = 4.0  # largest factor by which contrast multiplies density
    bounded_colour: bool = True  # rgb through a sigmoid; False in the authors' files, whose colours leave [0, 1]
    architecture: str = "codenerf"  # or "M1", "M2" (architecture_variants)

    def __post_init__(self) -> None:
        if self.architecture not in ("codenerf", "M1", "M2"):
            raise ValueError(f"unknown architecture: {self.architecture}")
        for name, (low, high) in _SIZES.items():
            if not low <= whole(getattr(self, name), name) <= high:
                raise ValueError(f"{name} of a field is {low} to {high}, got {getattr(self, name)}")
        if self.width % 2:
            raise ValueError(f"width of a field is even, got {self.width}")
        if number(self.density_scale, "density_scale") <= 0:
            raise ValueError(f"density_scale of a field is positive, got {self.density_scale}")
        if number(self.contrast, "contrast") < 0 or number(self.contrast_gain, "contrast_gain") < 1:
            raise ValueError(f"contrast of a field is >= 0, its gain >= 1: {self.contrast}, {self.contrast_gain}")
