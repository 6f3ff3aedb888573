"""A car's body while it is being cut up, and the regions that it is cut along."""

from collections.abc import Callable, Sequence

import numpy as np

from core.lab.datasets.procedural.cars.dimensions import Along, Heights
from core.lab.datasets.procedural.carving import Region, Values, carve, joined
from core.lab.datasets.procedural.solids import Part, Points, Solid

Line = Callable[[Along], Heights]
Inside = Callable[[Points], Values]


class Skin:
    """The right half of a body (x >= 0) while it is being cut up: a mesh for each label."""

    def __init__(self, whole: Solid) -> None:
        self._pieces = {"paint": whole}

    def label(self, name: str, region: Region, of: Sequence[str] = ("paint",)) -> None:
        """Relabel the parts of meshes ``of`` that lie in a region."""
        self.add(name, self.cut_out(region, of))

    def cut_out(self, region: Region, of: Sequence[str]) -> Solid:
        """Remove the part of the body in a region and return it."""
        found = []
        for old in of:
            if old in self._pieces:
                inside, self._pieces[old] = carve(self._pieces[old], region)
                found.append(inside)
        return joined(found)

    def add(self, name: str, solid: Solid) -> None:
        """Add a mesh to those of a label."""
        if len(solid.faces):
            self._pieces[name] = joined([self._pieces[name], solid]) if name in self._pieces else solid

    def parts(self) -> list[Part]:
        """Return all meshes with their labels."""
        return [Part(label, solid) for label, solid in self._pieces.items() if len(solid.faces)]


def over(line: Line, by: float = 0.0) -> Inside:
    """Return the region above a line along the car, by more than ``by`` m."""
    return lambda p: p[:, 2] - line(p[:, 1]) - by


def under(line: Line, by: float = 0.0) -> Inside:
    """Return the region below a line along the car, by more than ``by`` m."""
    return lambda p: line(p[:, 1]) - by - p[:, 2]


def between(axis: int, low: float, high: float) -> Region:
    """Return the region from ``low`` to ``high`` along an axis; two functions also find gaps narrower than the mesh."""
    return (lambda p: p[:, axis] - low, lambda p: high - p[:, axis])


def disc(axes: tuple[int, int], centre: tuple[float, float], radius: float) -> Inside:
    """Return a disc as seen along the third axis."""
    return lambda p: radius - np.hypot(p[:, axes[0]] - centre[0], p[:, axes[1]] - centre[1])
