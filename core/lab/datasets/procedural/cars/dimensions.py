"""The dimensions shared by a car's parts, and the lines derived from them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from core.lab.datasets.procedural.solids import Points, rounded_path

Heights = Float[np.ndarray, "*points"]
Along = Heights | float


@dataclass(frozen=True)
class CarDimensions:
    """A car's dimensions; m, the road at z = 0, the middle of its length at y = 0, the front at +y."""

    kind: str
    length: float
    width: float
    height: float
    clearance: float
    wheel: float  # radius
    axles: tuple[float, float]  # y of the front and the rear axle
    corners: tuple[tuple[float, float], ...]
    """(y, z) of the side profile from the front's upper edge over the roof to the rear's, before rounding"""
    nose: float  # height of the bonnet's front edge
    cowl: tuple[float, float]  # (y, z) of the windscreen's foot
    head: float  # y where the roof begins
    roof_end: float  # y where the roof ends
    tail: float  # height of the lower edge of the boot lid or tailgate, at the rear lights
    rear_glass: tuple[float, float] | None  # z of lower and upper edge
    side_glass: float  # y where the last side window ends
    pillars: tuple[float, ...]  # y of the pillars between side windows
    doors: int
    belt: tuple[float, float]  # height of the side windows' lower edge, at the cowl and at the rear
    tumble: float  # inward lean of the cabin's sides, m per m of height
    ledge: float  # inset of the cabin from the body's side
    crown: float  # height of the roof's middle over its edges
    cut: float  # rounding of the sections' corners, as a fraction of each side
    bow: float  # forward bulge of the middle of front and rear
    narrow: float  # fraction by which front and rear are narrower than the middle
    bed: tuple[float, float] | None = None  # y of the ends of a pickup's bed

    @cached_property
    def profile(self) -> Float[np.ndarray, "points 2"]:
        """(y, z) of the middle of bonnet, windscreen, roof and rear, y rising."""
        return rounded_path(self.corners, rounds=3, cut=0.13)[::-1]

    @property
    def end(self) -> float:
        """y of the front; the rear's is its negative."""
        return self.length / 2

    def top(self, y: Along) -> Heights:
        """Return the height of the middle."""
        return np.asarray(np.interp(y, *self.profile.T))

    def beltline(self, y: Along) -> Heights:
        """Return the height of the side windows' lower edge."""
        return np.asarray(np.interp(y, (-self.end, self.cowl[0]), self.belt[::-1]))

    def edge(self, y: Along) -> Heights:
        """Return the height of the line between side and roof or bonnet."""
        return np.asarray(self.top(y) - self.crown)

    def shoulder(self, y: Along) -> Heights:
        """Return the height up to which the body's side is upright."""
        return np.asarray(np.minimum(self.beltline(y), self.edge(y) - 0.02))

    def floor(self, y: Along) -> Heights:
        """Return the height of the underside, which rises towards both ends."""
        return np.asarray(self.clearance + 0.1 * np.clip(1 - (self.end - np.abs(y)) / 0.6, 0, 1) ** 2)

    def half(self, y: Along) -> Heights:
        """Return half of the body's width."""
        near = np.clip(1 - (self.end - np.abs(y)) / 0.55, 0, 1)
        return np.asarray(self.width / 2 * (1 - self.narrow * near**2.2))

    def rail(self, y: Along) -> Heights:
        """Return x of the line between side and roof or bonnet."""
        rise = self.edge(y) - self.shoulder(y)
        return np.asarray(0.985 * self.half(y) - self.ledge * np.clip(rise / 0.12, 0, 1) - self.tumble * rise)

    def bent(self, points: Points) -> Points:
        """Bow front and rear as seen from above, and let them swell as seen from the side."""
        x, y, z = points.T
        share = y / self.end
        bow = -self.bow * (2 * x / self.width) ** 2 * share * np.abs(share) ** 0.4
        middle, half = (self.clearance + self.nose) / 2, (self.nose - self.clearance) / 2
        swell = 0.05 * (1 - ((z - middle) / half) ** 2) * np.clip((np.abs(share) - 0.88) / 0.12, 0, 1) ** 2
        low = z < self.nose
        return np.stack((x, y + bow + np.where(low, np.sign(y) * swell, 0.0), z), -1)
