"""A car's windows, and the roof and the pillars between them."""

import numpy as np

from core.lab.datasets.procedural.cars.dimensions import Along, CarDimensions, Heights
from core.lab.datasets.procedural.cars.skin import Skin, between, over, under
from core.lab.datasets.procedural.carving import Values
from core.lab.datasets.procedural.solids import Points

_POST = 0.035  # m, half the width of a pillar between side windows


def windows(g: np.random.Generator, dims: CarDimensions, skin: Skin) -> None:
    """Label windscreen, rear and side windows; the rest of the cabin becomes roof and pillars."""
    header = dims.height - 0.075
    _end_windows(dims, skin, header, post=g.uniform(0.05, 0.08))
    _side_windows(dims, skin, frame=g.uniform(0.03, 0.05), lean=g.uniform(0.06, 0.14))
    _cabin(dims, skin, header)


def _end_windows(dims: CarDimensions, skin: Skin, header: float, post: float) -> None:
    """Label windscreen and rear window, ``post`` m away from the sides."""

    def inner(p: Points) -> Values:
        return dims.rail(p[:, 1]) - post - p[:, 0]

    ahead = between(1, dims.head - 0.05, dims.end)
    skin.label("glass", [*ahead, *between(2, dims.cowl[1] + 0.03, header), inner])
    if dims.rear_glass is not None:
        skin.label("glass", [*between(1, -dims.end, dims.roof_end + 0.02), *between(2, *dims.rear_glass), inner])


def _side_windows(dims: CarDimensions, skin: Skin, frame: float, lean: float) -> None:
    """Label one band of glass, ``frame`` m below the roof and ``lean`` m from the cabin's ends, then its pillars."""

    def eaves(y: Along) -> Heights:
        return np.asarray(np.minimum.reduce([dims.edge(y), dims.edge(y + lean), dims.edge(y - lean)]))

    def ahead_of_rear_pillar(p: Points) -> Values:
        return p[:, 1] - dims.side_glass - 0.25 * (p[:, 2] - dims.belt[1])

    skin.label("glass", [over(dims.beltline, 0.025), under(eaves, frame), ahead_of_rear_pillar])
    for y in dims.pillars:
        skin.label("pillar", [*between(1, y - _POST, y + _POST), under(eaves, frame)], of=("glass",))


def _cabin(dims: CarDimensions, skin: Skin, header: float) -> None:
    """Label roof and pillars above the waist."""
    rear_header = header if dims.rear_glass is None else dims.rear_glass[1]
    lowest = min(header, rear_header, float(dims.edge(dims.roof_end))) - 0.01
    skin.label("roof", [over(dims.edge, -0.03), *between(2, lowest, np.inf)])
    rear = dims.tail if dims.rear_glass is None else dims.rear_glass[0] - 0.03
    y, z = dims.profile.T
    last = float(y[z > max(rear, dims.belt[1]) + 0.05].min())
    waist = np.array(
        [(last, rear), (dims.roof_end, dims.belt[1]), (dims.head, dims.belt[0]), (dims.cowl[0], dims.cowl[1] + 0.03)]
    )

    def line(y: Along) -> Heights:
        return np.asarray(np.maximum(np.interp(y, *waist.T), dims.beltline(y) + 0.01))

    skin.label("pillar", [over(line), *between(1, last, dims.cowl[0])])
