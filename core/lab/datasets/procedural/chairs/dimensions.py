"""The dimensions shared by a chair's parts, and the surface of its back rest."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from core.lab.datasets.procedural.solids import Points, Solid, warped


@dataclass(frozen=True)
class ChairDimensions:
    """A chair's dimensions; m, the floor at z = 0."""

    width: float
    depth: float
    height: float  # of the seat's upper side
    thick: float  # of the seat
    back: float  # height of the back rest above the seat
    recline: float = 0.15  # backward lean of the back rest, m per m of height
    curve: float = 0.03  # forward bend of the back rest's sides, m
    corner: float = 0.05
    taper: float = 0.0

    def rear(self, x: Float[np.ndarray, "*points"], up: Float[np.ndarray, "*points"]) -> Float[np.ndarray, "*points"]:
        """Return y of the back rest's middle layer at x, ``up`` m above the seat."""
        bend = self.curve * ((2 * x / self.width) ** 2 - 0.5)
        return np.asarray(-self.depth / 2 + 0.02 - self.recline * up + bend)

    def upright(self, solid: Solid) -> Solid:
        """Bend a solid built flat as (x, up, towards the sitter) onto the back rest."""

        def bend(flat: Points) -> Points:
            x, up, out = flat.T
            return np.stack((x, self.rear(x, up) + out, self.height + up), -1)

        return warped(solid, bend, mirrors=True)


def sample_dimensions(g: np.random.Generator, **given: float) -> ChairDimensions:
    """Sample an ordinary chair's dimensions, some of them given."""
    sampled = {
        "width": g.uniform(0.4, 0.52),
        "depth": g.uniform(0.4, 0.48),
        "height": g.uniform(0.42, 0.48),
        "thick": g.uniform(0.02, 0.045),
        "back": g.uniform(0.34, 0.62),
        "recline": g.uniform(0.03, 0.26),
        "curve": g.choice((0.0, g.uniform(0.01, 0.07))),
        "corner": g.choice((0.01, g.uniform(0.03, 0.12))),
        "taper": g.choice((0.0, g.uniform(0.05, 0.22))),
    }
    return ChairDimensions(**{name: float(value) for name, value in (sampled | given).items()})
