"""A car's windows, and the roof and the pillars between them."""

import numpy as np

from core.datasets.procedural.cars.dimensions import Along, CarPlan, Heights
from core.datasets.procedural.cars.skin import Skin, between, over, under
from core.datasets.procedural.carving import Values
from core.datasets.procedural.solids import Points

_POST = 0.035
"""m, half the width of a pillar between side windows"""


def windows(g: np.random.Generator, plan: CarPlan, skin: Skin) -> None:
    """Windscreen, rear window and side windows; what of the cabin is left between them is roof and pillars."""
    header = plan.height - 0.075
    _end_windows(plan, skin, header, post=g.uniform(0.05, 0.08))
    _side_windows(plan, skin, frame=g.uniform(0.03, 0.05), lean=g.uniform(0.06, 0.14))
    _cabin(plan, skin, header)


def _end_windows(plan: CarPlan, skin: Skin, header: float, post: float) -> None:
    """Windscreen and rear window, ``post`` m away from the sides."""

    def inner(p: Points) -> Values:
        return plan.rail(p[:, 1]) - post - p[:, 0]

    ahead = between(1, plan.head - 0.05, plan.end)
    skin.label("glass", [*ahead, *between(2, plan.cowl[1] + 0.03, header), inner])
    if plan.rear_glass is not None:
        skin.label("glass", [*between(1, -plan.end, plan.roof_end + 0.02), *between(2, *plan.rear_glass), inner])


def _side_windows(plan: CarPlan, skin: Skin, frame: float, lean: float) -> None:
    """One band of glass, ``frame`` m below the roof and ``lean`` m from the ends of the cabin, then its pillars."""

    def eaves(y: Along) -> Heights:
        return np.asarray(np.minimum.reduce([plan.edge(y), plan.edge(y + lean), plan.edge(y - lean)]))

    def ahead_of_rear_pillar(p: Points) -> Values:
        return p[:, 1] - plan.side_glass - 0.25 * (p[:, 2] - plan.belt[1])

    skin.label("glass", [over(plan.beltline, 0.025), under(eaves, frame), ahead_of_rear_pillar])
    for y in plan.pillars:
        skin.label("pillar", [*between(1, y - _POST, y + _POST), under(eaves, frame)], of=("glass",))


def _cabin(plan: CarPlan, skin: Skin, header: float) -> None:
    """Roof and pillars: what is left above the waist."""
    rear_header = header if plan.rear_glass is None else plan.rear_glass[1]
    lowest = min(header, rear_header, float(plan.edge(plan.roof_end))) - 0.01
    skin.label("roof", [over(plan.edge, -0.03), *between(2, lowest, np.inf)])
    rear = plan.tail if plan.rear_glass is None else plan.rear_glass[0] - 0.03
    y, z = plan.profile.T
    last = float(y[z > max(rear, plan.belt[1]) + 0.05].min())
    waist = np.array(
        [(last, rear), (plan.roof_end, plan.belt[1]), (plan.head, plan.belt[0]), (plan.cowl[0], plan.cowl[1] + 0.03)]
    )

    def line(y: Along) -> Heights:
        return np.asarray(np.maximum(np.interp(y, *waist.T), plan.beltline(y) + 0.01))

    skin.label("pillar", [over(line), *between(1, last, plan.cowl[0])])
