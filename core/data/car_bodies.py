"""A car's body: one skin lofted from the plan's profile, then cut up into paint, glass, lamps and the rest."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from core.data.car_plans import CarPlan
from core.data.carving import Region, Values, carve, joined, sunk
from core.data.parts import Part, Points, Solid, quads, rounded_path

_STEP = 0.12
"""m along the profile from one section to the next"""
_SEAM = 0.009
"""m, half the width of the gap around a door"""


class Skin:
    """The right half of a body (x >= 0) while it is being cut up: a mesh for each label."""

    def __init__(self, whole: Solid) -> None:
        self._pieces = {"paint": whole}

    def label(self, name: str, region: Region, of: Sequence[str] = ("paint",)) -> None:
        """Gives what lies in the region, and is labelled as one of ``of``, another label."""
        self.add(name, self.cut_out(region, of))

    def cut_out(self, region: Region, of: Sequence[str]) -> Solid:
        """What lies in the region, taken out of the body."""
        found = []
        for old in of:
            if old in self._pieces:
                inside, self._pieces[old] = carve(self._pieces[old], region)
                found.append(inside)
        return joined(found)

    def add(self, name: str, solid: Solid) -> None:
        """Adds a mesh to those of a label."""
        if len(solid.faces):
            self._pieces[name] = joined([self._pieces[name], solid]) if name in self._pieces else solid

    def parts(self) -> list[Part]:
        """All that is there."""
        return [Part(label, solid) for label, solid in self._pieces.items() if len(solid.faces)]


def body(g: np.random.Generator, plan: CarPlan) -> list[Part]:
    """The right half of the body, before it is bowed."""
    skin = Skin(_sheet(plan))
    skin.label("under", [lambda p: plan.floor(p[:, 1]) + 0.035 - p[:, 2]])
    _wheel_arches(g, plan, skin)
    if plan.bed is not None:
        _bed(plan, skin, plan.bed)
    _windows(g, plan, skin)
    _lamps(g, plan, skin)
    _front(g, plan, skin)
    _plates(g, plan, skin)
    _seams(plan, skin)
    _colour_fields(g, plan, skin)
    return skin.parts()


def _sheet(plan: CarPlan) -> Solid:
    """Sections from the rear to the front, each from the floor's middle over the side to the roof's, and both ends."""
    near = np.array([0.0, 0.012, 0.04, 0.09])
    way = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(plan.profile, axis=0), axis=1))))
    even = np.interp(np.linspace(0, way[-1], round(way[-1] / _STEP)), way, plan.profile[:, 0])
    inner = even[np.abs(even) < plan.end - 0.1]
    y = np.concatenate((near - plan.end, inner, plan.end - near[::-1]))
    sections = _sections(plan, y)
    grid = np.concatenate((_cap(sections[0])[::-1], sections, _cap(sections[-1])))
    points = grid.reshape(-1, 3)
    return Solid(points, quads(np.arange(len(points)).reshape(grid.shape[:2]))[:, ::-1], points)


def _cap(section: Float[np.ndarray, "corners 3"]) -> Float[np.ndarray, "5 corners 3"]:
    """A section shrinking to its middle: the face of the front or the rear."""
    middle = np.array([0.0, section[0, 1], section[[0, -1], 2].mean()])
    return middle + (section - middle) * np.array([0.85, 0.65, 0.4, 0.2, 0.0])[:, None, None]


def _sections(plan: CarPlan, y: Float[np.ndarray, "sections"]) -> Float[np.ndarray, "sections corners 3"]:
    """Half outlines across the car, right side, their corners cut round."""
    low, half, shoulder, edge, top = (f(y) for f in (plan.floor, plan.half, plan.shoulder, plan.edge, plan.top))
    rail, side = plan.rail(y), 0.985 * half
    step = plan.ledge * np.clip((edge - shoulder) / 0.12, 0, 1)
    high = shoulder - low
    corners = [
        (0 * y, low),
        (0.86 * half, low),
        (0.945 * half, low + 0.06 * high),
        (0.975 * half, low + 0.3 * high),
        (half, low + 0.68 * high),
        (side, shoulder),
        (side - step, shoulder + 0.3 * np.minimum(step, edge - shoulder)),
        (rail, edge),
        (0.5 * rail, top - 0.25 * plan.crown),
        (0 * y, top),
    ]
    path = rounded_path(np.array(corners).reshape(len(corners), -1), rounds=2, cut=plan.cut)
    x, z = path.reshape(len(path), 2, -1).transpose(1, 2, 0)
    return np.stack((x, np.broadcast_to(y[:, None], x.shape), z), -1)


def _wheel_arches(g: np.random.Generator, plan: CarPlan, skin: Skin) -> None:
    """Recesses for the wheels, with a lip around them."""
    gap, lip, deep = g.uniform(0.03, 0.07), g.uniform(0.02, 0.06), 0.3
    for axle in plan.axles:
        inner = float(plan.half(axle)) - deep

        def within(radius: float, inner: float = inner, axle: float = axle) -> Region:
            def disc(p: Points) -> Values:
                return radius - np.hypot(p[:, 1] - axle, p[:, 2] - plan.wheel)

            return [lambda p: p[:, 0] - inner, disc]

        hole = skin.cut_out(within(plan.wheel + gap), ("paint", "under"))
        skin.add("under", sunk(hole, lambda p, inner=inner: np.stack((np.full(len(p), inner), *p.T[1:]), -1)))  # type: ignore[misc]
        skin.label("arch", within(plan.wheel + gap + lip))


def _bed(plan: CarPlan, skin: Skin, bed: tuple[float, float]) -> None:
    """A pickup's open bed, its floor above the wheel arches."""
    front, rear = bed
    floor = 2 * plan.wheel + 0.09
    wide = plan.width / 2 * (1 - plan.narrow) - 0.1
    above: Region = [
        lambda p: p[:, 2] - plan.edge(p[:, 1]) + 0.03,
        *_between(1, rear, front),
        lambda p: wide - p[:, 0],
    ]
    hole = skin.cut_out(above, ("paint",))
    skin.add("bed", sunk(hole, lambda p: np.stack((p[:, 0], p[:, 1], np.full(len(p), floor)), -1)))


def _windows(g: np.random.Generator, plan: CarPlan, skin: Skin) -> None:
    """Windscreen, rear window and side windows; what of the cabin is left between them is roof and pillars."""
    post, frame = g.uniform(0.05, 0.08), g.uniform(0.03, 0.05)
    lean = g.uniform(0.06, 0.14)

    def inner(p: Points) -> Values:
        return plan.rail(p[:, 1]) - post - p[:, 0]

    above: Callable[[Points], Values] = lambda p: p[:, 2] - plan.beltline(p[:, 1])  # noqa: E731
    roof = plan.height - 0.075
    skin.label("glass", [lambda p: p[:, 1] - plan.head + 0.05, *_between(2, plan.cowl[1] + 0.03, roof), inner, above])
    if plan.rear_glass is not None:
        skin.label("glass", [lambda p: plan.roof_end + 0.02 - p[:, 1], *_between(2, *plan.rear_glass), inner])

    def under_roof(p: Points) -> Values:
        y = p[:, 1]
        lowest = np.minimum.reduce([plan.edge(y), plan.edge(y + lean), plan.edge(y - lean)])
        return lowest - frame - p[:, 2]

    def behind(p: Points) -> Values:
        return p[:, 1] - plan.side_glass - 0.25 * (p[:, 2] - plan.belt[1])

    side: Region = [lambda p: above(p) - 0.025, under_roof, behind]
    skin.label("glass", side)
    for y in plan.pillars:
        skin.label("pillar", [*_between(1, y - 0.035, y + 0.035), under_roof], of=("glass",))
    _cabin(plan, skin, roof)


def _cabin(plan: CarPlan, skin: Skin, windscreen_top: float) -> None:
    """Roof and pillars: what is left above the waist."""
    low = plan.rear_glass[1] if plan.rear_glass is not None else windscreen_top
    eaves = min(windscreen_top, low, float(plan.edge(plan.roof_end))) - 0.01
    skin.label("roof", [lambda p: p[:, 2] - plan.edge(p[:, 1]) + 0.03, lambda p: p[:, 2] - eaves])
    y, z = plan.profile.T
    rear = plan.rear_glass[0] - 0.03 if plan.rear_glass is not None else plan.tail
    last = float(y[z > max(rear, plan.belt[1]) + 0.05].min())
    waist = ((last, plan.roof_end, plan.head, plan.cowl[0]), (rear, plan.belt[1], plan.belt[0], plan.cowl[1] + 0.03))

    def above(p: Points) -> Values:
        return p[:, 2] - np.maximum(np.interp(p[:, 1], *waist), plan.beltline(p[:, 1]) + 0.01)

    skin.label("pillar", [above, *_between(1, last, plan.cowl[0])])


def _lamps(g: np.random.Generator, plan: CarPlan, skin: Skin) -> None:
    """Head lights and tail lights."""
    x = plan.width / 2 * (1 - plan.narrow)
    high, wrap = plan.nose * g.uniform(0.86, 0.93), g.uniform(0.12, 0.4)
    at_front: Callable[[Points], Values] = lambda p: p[:, 1] - plan.end + wrap  # noqa: E731
    if g.random() < 0.25:
        radius = g.uniform(0.08, 0.105)
        centre = (x - g.uniform(1.4, 1.9) * radius, high - radius)
        skin.label("light", [at_front, _disc(centre, radius)])
    else:
        tall, slant, wide = g.uniform(0.09, 0.17), g.uniform(-0.05, 0.16), g.uniform(0.26, 0.5)
        upper: Callable[[Points], Values] = lambda p: high + slant * (p[:, 0] - x) - p[:, 2]  # noqa: E731
        skin.label("light", [at_front, upper, lambda p: tall - upper(p), lambda p: p[:, 0] - x + wide])
    _tail_lamps(g, plan, skin, x)


def _tail_lamps(g: np.random.Generator, plan: CarPlan, skin: Skin, x: float) -> None:
    upright = plan.kind in ("hatchback", "estate", "SUV", "van", "pickup") and g.random() < 0.6
    wide, tall = (
        (g.uniform(0.1, 0.2), g.uniform(0.25, 0.42)) if upright else (g.uniform(0.25, 0.5), g.uniform(0.1, 0.2))
    )
    high, wrap = plan.tail + (0.3 if upright else 0.55) * tall, g.uniform(0.08, 0.28)
    if plan.kind == "pickup":
        high = plan.tail + 0.04
    at_rear: Callable[[Points], Values] = lambda p: -plan.end + wrap - p[:, 1]  # noqa: E731
    if not upright and g.random() < 0.12:
        wide = x
    lamp: Region = [at_rear, *_between(2, high - tall, high), lambda p: p[:, 0] - x + wide]
    skin.label("tail", lamp, of=("paint", "pillar"))


def _front(g: np.random.Generator, plan: CarPlan, skin: Skin) -> None:
    """The grille, the intake below it, fog lights."""
    ahead: Callable[[Points], Values] = lambda p: p[:, 1] - plan.end + 0.12  # noqa: E731
    high = plan.nose * g.uniform(0.8, 0.88)
    tall, wide = g.uniform(0.06, 0.22), g.uniform(0.2, 0.5)
    taper = g.uniform(-0.5, 0.6)

    def grille(margin: float) -> Region:
        def sides(p: Points) -> Values:
            return wide - margin - p[:, 0] + taper * (p[:, 2] - high)

        return [ahead, *_between(2, high - tall + margin, high - margin), sides]

    if g.random() < 0.85:
        frame = g.uniform(0.012, 0.022)
        skin.label("chrome", grille(0.0))
        skin.label("grille", grille(frame), of=("chrome",))
    low = float(plan.floor(plan.end)) + g.uniform(0.04, 0.09)
    reach = g.uniform(0.3, 0.65)
    if g.random() < 0.8:
        intake: Region = [ahead, *_between(2, low, low + g.uniform(0.05, 0.11)), lambda p: reach - p[:, 0]]
        skin.label("grille", intake)


def _plates(g: np.random.Generator, plan: CarPlan, skin: Skin) -> None:
    wide, tall = (0.26, 0.06) if g.random() < 0.6 else (0.16, 0.08)
    front = 0.5 * (plan.nose + plan.clearance) - g.uniform(0.0, 0.06)
    rear = plan.tail - g.uniform(0.1, 0.35)
    for sign, z in ((1, front), (-1, rear)):
        face: Region = [
            lambda p, sign=sign: sign * p[:, 1] - plan.end + 0.1,  # type: ignore[misc]
            *_between(2, z - tall, z + tall),
            lambda p: wide - p[:, 0],
        ]
        skin.label("plate", face, of=("paint", "grille", "chrome"))


def _seams(plan: CarPlan, skin: Skin) -> None:
    """The gaps at the doors' front and rear edges."""
    first = plan.cowl[0] - 0.08
    behind = plan.pillars[0] if plan.pillars else first - 1.1
    seams = [first, behind]
    if plan.doors == 4 and plan.kind != "van":
        seams.append(max(behind - 0.85, plan.axles[1] + plan.wheel + 0.1))
    for y in seams:
        gap: Region = [
            *_between(1, y - _SEAM, y + _SEAM),
            lambda p: p[:, 0] - 0.8 * plan.half(p[:, 1]),
            lambda p: p[:, 2] - plan.clearance - 0.12,
        ]
        skin.label("seam", gap, of=("paint",))


def _colour_fields(g: np.random.Generator, plan: CarPlan, skin: Skin) -> None:
    """Bumpers, sills, a band along the side and a stripe along the middle: often painted like the rest."""
    sill = plan.clearance + g.uniform(0.12, 0.2) * plan.height
    bumper = plan.clearance + g.uniform(0.3, 0.55) * (plan.nose - plan.clearance)
    depth = g.uniform(0.3, 0.45)
    skin.label("bumper", [lambda p: np.abs(p[:, 1]) - plan.end + depth, lambda p: bumper - p[:, 2]])
    skin.label("sill", [lambda p: sill - p[:, 2]])
    wide, apart = g.uniform(0.12, 0.25), g.choice((-1e-9, 0.05))
    middle: Region = [
        lambda p: p[:, 2] - plan.edge(p[:, 1]),
        lambda p: plan.end - 0.1 - np.abs(p[:, 1]),
        lambda p: p[:, 0] - apart,
        lambda p: apart + wide - p[:, 0],
    ]
    skin.label("stripe", middle)
    skin.label("roof stripe", middle, of=("roof",))
    share, tall = g.uniform(0.45, 0.75), g.uniform(0.06, 0.14)
    line = plan.clearance + share * (plan.belt[0] - plan.clearance)
    side: Region = [*_between(2, line - tall / 2, line + tall / 2), lambda p: p[:, 0] - 0.9 * plan.half(p[:, 1])]
    skin.label("band", [*side, lambda p: plan.end - 0.25 - np.abs(p[:, 1])])


def _between(axis: int, low: float, high: float) -> Region:
    """From ``low`` to ``high`` along an axis; two functions, so that a gap narrower than the mesh is found too."""
    return (lambda p: p[:, axis] - low, lambda p: high - p[:, axis])


def _disc(centre: tuple[float, float], radius: float) -> Callable[[Points], Values]:
    """Positive in a disc of the xz plane."""

    def inside(p: Points) -> Values:
        return radius - np.hypot(p[:, 0] - centre[0], p[:, 2] - centre[1])

    return inside
