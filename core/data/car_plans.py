"""The measures that a car's parts agree on, and how they are drawn for each kind of car."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from core.data.parts import Points, rounded_path

Heights = Float[np.ndarray, "*points"]
Along = Heights | float


@dataclass(frozen=True)
class CarPlan:
    """A car's measures; m, the road at z = 0, the middle of its length at y = 0, the front at +y."""

    kind: str
    length: float
    width: float
    height: float
    clearance: float
    wheel: float
    """radius"""
    axles: tuple[float, float]
    """y of the front and the rear one"""
    corners: tuple[tuple[float, float], ...]
    """(y, z) of the side profile from the front's upper edge over the roof to the rear's, before it is rounded"""
    nose: float
    """height of the bonnet's front edge"""
    cowl: tuple[float, float]
    """(y, z) where the windscreen begins"""
    head: float
    """y where the roof begins"""
    roof_end: float
    """y where it ends"""
    tail: float
    """height of the boot lid's or tailgate's lower edge, where the rear's lights are"""
    rear_glass: tuple[float, float] | None
    """z from and to"""
    side_glass: float
    """y where the last side window ends"""
    pillars: tuple[float, ...]
    """y of the pillars between side windows"""
    doors: int
    belt: tuple[float, float]
    """height of the side windows' lower edge, at the cowl and at the rear"""
    tumble: float
    """how far the cabin's sides lean in for each m that they rise"""
    ledge: float
    """how far the cabin stands in from the body's side"""
    crown: float
    """how much higher the roof is in the middle than at its edges"""
    cut: float
    """how round the sections' corners are: the share of each side that a corner takes"""
    bow: float
    """how far the middle of front and rear stand out before their corners"""
    narrow: float
    """by which share front and rear are narrower than the middle"""
    bed: tuple[float, float] | None = None
    """y from and to of a pickup's bed"""

    @cached_property
    def profile(self) -> Float[np.ndarray, "points 2"]:
        """(y, z) of the middle of bonnet, windscreen, roof and rear, y rising."""
        return rounded_path(self.corners, rounds=3, cut=0.13)[::-1]

    @property
    def end(self) -> float:
        """y of the front; the rear's is its negative."""
        return self.length / 2

    def top(self, y: Along) -> Heights:
        """Height of the middle."""
        return np.asarray(np.interp(y, *self.profile.T))

    def beltline(self, y: Along) -> Heights:
        """Height of the side windows' lower edge."""
        return np.asarray(np.interp(y, (-self.end, self.cowl[0]), self.belt[::-1]))

    def edge(self, y: Along) -> Heights:
        """Height of the line where the side turns into the roof or the bonnet."""
        return np.asarray(self.top(y) - self.crown)

    def shoulder(self, y: Along) -> Heights:
        """Height up to which the body's side is upright."""
        return np.asarray(np.minimum(self.beltline(y), self.edge(y) - 0.02))

    def floor(self, y: Along) -> Heights:
        """Height of the underside, which rises towards both ends."""
        return np.asarray(self.clearance + 0.1 * np.clip(1 - (self.end - np.abs(y)) / 0.6, 0, 1) ** 2)

    def half(self, y: Along) -> Heights:
        """Half of the body's width."""
        near = np.clip(1 - (self.end - np.abs(y)) / 0.55, 0, 1)
        return np.asarray(self.width / 2 * (1 - self.narrow * near**2.2))

    def rail(self, y: Along) -> Heights:
        """x of the line where the side turns into the roof or the bonnet."""
        rise = self.edge(y) - self.shoulder(y)
        return np.asarray(0.985 * self.half(y) - self.ledge * np.clip(rise / 0.12, 0, 1) - self.tumble * rise)

    def bent(self, points: Points) -> Points:
        """Points of the straight plan, front and rear bowed as seen from above and swollen as seen from the side."""
        x, y, z = points.T
        share = y / self.end
        bow = -self.bow * (2 * x / self.width) ** 2 * share * np.abs(share) ** 0.4
        middle, half = (self.clearance + self.nose) / 2, (self.nose - self.clearance) / 2
        swell = 0.05 * (1 - ((z - middle) / half) ** 2) * np.clip((np.abs(share) - 0.88) / 0.12, 0, 1) ** 2
        low = z < self.nose
        return np.stack((x, y + bow + np.where(low, np.sign(y) * swell, 0.0), z), -1)


def car_plan(g: np.random.Generator, kind: str) -> CarPlan:
    """A car's measures. Raises ``KeyError`` for an unknown kind."""
    return KINDS[kind][0](g)


def _sedan(g: np.random.Generator) -> CarPlan:
    deck, run = g.uniform(0.4, 0.75), g.uniform(0.5, 0.8)
    return _notchback(g, "sedan", deck, run, length=g.uniform(4.25, 5.05), height=g.uniform(1.4, 1.5))


def _coupe(g: np.random.Generator) -> CarPlan:
    deck, run = g.uniform(0.1, 0.45), g.uniform(0.7, 1.1)
    return _notchback(
        g,
        "coupe",
        deck,
        run,
        length=g.uniform(4.0, 4.75),
        height=g.uniform(1.24, 1.37),
        nose=g.uniform(0.82, 0.92),
        clearance=g.uniform(0.11, 0.16),
        screen=g.uniform(0.7, 0.9),
        cowl_back=g.uniform(0.45, 0.75),
        wheel=g.uniform(0.315, 0.355),
        doors=2.0,
        tumble=g.uniform(0.3, 0.45),
        narrow=g.uniform(0.1, 0.2),
    )


def _notchback(g: np.random.Generator, kind: str, deck: float, run: float, **given: float) -> CarPlan:
    """A car with a boot lid."""
    m = _measures(g, **given)
    rear, tail = -m["length"] / 2, m["cowl"] + g.uniform(0.0, 0.09)
    head = m["length"] / 2 - m["overhang"] - m["cowl_back"] - m["screen"]
    roof_end = min(rear + deck + run, head - 0.55)
    lid = [(rear + deck, tail), (rear + 0.05, tail - g.uniform(0.0, 0.05)), (rear, 0.72 * tail)]
    glass = (tail + 0.05, m["height"] - 0.09)
    return _finished(kind, m, lid, roof_end, 0.78 * tail, glass, rear + deck + 0.12)


def _hatchback(g: np.random.Generator) -> CarPlan:
    m = _measures(
        g,
        length=g.uniform(3.2, 4.35),
        width=g.uniform(1.62, 1.82),
        height=g.uniform(1.42, 1.58),
        cowl_back=g.uniform(0.2, 0.4),
        front=g.uniform(0.185, 0.205),
        basis=g.uniform(0.6, 0.64),
        doors=g.choice((2.0, 4.0)),
    )
    return _tailgated(g, "hatchback", m, g.uniform(0.3, 0.75))


def _estate(g: np.random.Generator) -> CarPlan:
    m = _measures(g, length=g.uniform(4.4, 4.95), height=g.uniform(1.43, 1.53))
    return _tailgated(g, "estate", m, g.uniform(0.25, 0.6))


def _suv(g: np.random.Generator) -> CarPlan:
    boxy = g.random() < 0.35
    m = _measures(
        g,
        length=g.uniform(4.05, 4.95),
        width=g.uniform(1.78, 1.98),
        height=g.uniform(1.6, 1.88),
        clearance=g.uniform(0.2, 0.28),
        wheel=g.uniform(0.35, 0.4),
        nose=g.uniform(0.84, 0.92),
        screen=g.uniform(0.3, 0.5) if boxy else g.uniform(0.55, 0.75),
        cut=0.06 if boxy else g.uniform(0.08, 0.13),
        tumble=g.uniform(0.08, 0.16) if boxy else g.uniform(0.18, 0.3),
    )
    return _tailgated(g, "SUV", m, g.uniform(0.06, 0.15) if boxy else g.uniform(0.25, 0.6))


def _tailgated(g: np.random.Generator, kind: str, m: Mapping[str, float], run: float) -> CarPlan:
    """A car whose roof goes on to the tailgate."""
    rear, tail = -m["length"] / 2, m["cowl"] + g.uniform(-0.04, 0.06)
    roof_end, glass = rear + run + 0.07, (tail + 0.04, m["height"] - g.uniform(0.1, 0.14))
    gate = [(rear + 0.07, tail), (rear + 0.02, 0.85 * tail), (rear, 0.6 * tail)]
    third = g.random() < 0.7 and kind != "hatchback"
    return _finished(kind, m, gate, roof_end, 0.8 * tail, glass, rear + (0.35 if third else 0.75))


def _van(g: np.random.Generator) -> CarPlan:
    height = g.uniform(1.75, 2.45)
    m = _measures(
        g,
        length=g.uniform(4.3, 5.7),
        width=g.uniform(1.78, 2.02),
        height=height,
        clearance=g.uniform(0.17, 0.22),
        wheel=g.uniform(0.32, 0.36),
        nose=g.uniform(0.74, 0.85),
        cowl_height=g.uniform(1.08, 1.25),
        cowl_back=g.uniform(-0.35, 0.1),
        screen=g.uniform(0.55, 0.8) * height / 2,
        tumble=g.uniform(0.06, 0.14),
        cut=g.uniform(0.05, 0.09),
        bow=g.uniform(0.1, 0.18),
        narrow=g.uniform(0.03, 0.08),
    )
    rear, tail = -m["length"] / 2, m["cowl"]
    roof_end = rear + g.uniform(0.1, 0.2)
    gate = [(rear + 0.05, tail), (rear + 0.02, 0.8 * tail), (rear, 0.55 * tail)]
    glazed = g.random() < 0.45
    cab = m["length"] / 2 - m["overhang"] - m["cowl_back"] - m["screen"] - g.uniform(0.75, 0.95)
    glass = (tail + 0.06, height - g.uniform(0.2, 0.3)) if glazed or g.random() < 0.6 else None
    return _finished("van", m, gate, roof_end, 0.95 * tail, glass, rear + 0.3 if glazed else cab)


def _pickup(g: np.random.Generator) -> CarPlan:
    m = _measures(
        g,
        length=g.uniform(4.9, 5.7),
        width=g.uniform(1.82, 2.02),
        height=g.uniform(1.68, 1.9),
        clearance=g.uniform(0.24, 0.32),
        wheel=g.uniform(0.36, 0.42),
        nose=g.uniform(0.84, 0.93),
        screen=g.uniform(0.45, 0.65),
        tumble=g.uniform(0.12, 0.24),
        cut=g.uniform(0.05, 0.09),
        narrow=g.uniform(0.04, 0.09),
        basis=g.uniform(0.58, 0.62),
        doors=g.choice((2.0, 4.0)),
    )
    rear, rail = -m["length"] / 2, m["cowl"] - g.uniform(0.0, 0.06)
    bed = rear + (g.uniform(1.3, 1.6) if m["doors"] == 4 else g.uniform(1.7, 2.1))
    gate = [(bed + 0.02, rail), (rear + 0.02, rail), (rear, 0.7 * rail)]
    glass = (m["cowl"] + 0.06, m["height"] - 0.12)
    plan = _finished("pickup", m, gate, bed + g.uniform(0.1, 0.25), 0.85 * rail, glass, bed + 0.16)
    return replace(plan, bed=(bed - 0.04, rear + 0.08)) if g.random() < 0.8 else plan


def _measures(g: np.random.Generator, **given: float) -> dict[str, float]:
    """An ordinary car's measures, with some of them given."""
    length, height = given.get("length", 4.5), given.get("height", 1.45)
    cowl = given.get("cowl_height", height * g.uniform(0.62, 0.67))
    drawn = {
        "length": length,
        "width": g.uniform(1.7, 1.9),
        "height": height,
        "clearance": g.uniform(0.14, 0.19),
        "wheel": g.uniform(0.295, 0.345),
        "basis": g.uniform(0.57, 0.615),
        "front": g.uniform(0.175, 0.205),
        "cowl_back": g.uniform(0.25, 0.5),
        "screen": g.uniform(0.6, 0.85),
        "nose": g.uniform(0.74, 0.88),
        "doors": 4.0,
        "rise": g.uniform(-0.01, 0.07),
        "tumble": g.uniform(0.22, 0.36),
        "ledge": g.uniform(0.015, 0.05),
        "crown": g.uniform(0.03, 0.06),
        "cut": g.choice((g.uniform(0.06, 0.09), g.uniform(0.09, 0.15))),
        "bow": g.uniform(0.1, 0.26),
        "narrow": g.uniform(0.06, 0.16),
        "droop": g.uniform(0.0, 0.06),
    }
    measures = {name: float(value) for name, value in (drawn | given).items()}
    return measures | {"cowl": cowl, "overhang": length * measures["front"]}


def _finished(
    kind: str,
    m: Mapping[str, float],
    rear: list[tuple[float, float]],
    roof_end: float,
    tail: float,
    rear_glass: tuple[float, float] | None,
    side_glass: float,
) -> CarPlan:
    """The plan of these measures; ``rear`` is the profile behind the roof."""
    end = m["length"] / 2
    axle = end - m["overhang"]
    axles = (axle, axle - m["basis"] * m["length"])
    cowl, nose = axle - m["cowl_back"], m["nose"] * m["cowl"]
    head = cowl - m["screen"]
    middle = head + 0.35 * (roof_end - head)
    top = m["height"]
    bonnet = (0.5 * (end - 0.1 + cowl), nose + 0.62 * (m["cowl"] - nose))
    front = [(end, 0.8 * nose), (end - 0.04, 0.97 * nose), (end - 0.2, nose + 0.1 * (m["cowl"] - nose)), bonnet]
    roof = [(cowl, m["cowl"]), (head, top - 0.035), (middle, top), (roof_end, top - 0.03 - m["droop"])]
    belt = m["cowl"] - 0.04
    plan = CarPlan(
        kind=kind,
        length=m["length"],
        width=m["width"],
        height=top,
        clearance=m["clearance"],
        wheel=m["wheel"],
        axles=axles,
        corners=(*front, *roof, *rear),
        nose=nose,
        cowl=(cowl, m["cowl"]),
        head=head,
        roof_end=roof_end,
        tail=tail,
        rear_glass=rear_glass,
        side_glass=side_glass,
        pillars=_pillars(int(m["doors"]), kind, cowl, head, side_glass),
        doors=int(m["doors"]),
        belt=(belt, belt + m["rise"]),
        tumble=m["tumble"],
        ledge=m["ledge"],
        crown=m["crown"],
        cut=m["cut"],
        bow=m["bow"],
        narrow=m["narrow"],
    )
    # A wheel arch must not reach up into the bonnet.
    low = float(plan.shoulder(axle + np.array((-0.3, 0.0, 0.3))).min())
    return replace(plan, wheel=min(plan.wheel, 0.5 * (low - 0.12)))


def _pillars(doors: int, kind: str, cowl: float, head: float, rear: float) -> tuple[float, ...]:
    """y of the pillars between the side windows: behind each door that has a window behind it."""
    first = min(head - (0.65 if doors == 2 else 0.45), cowl - 0.95)
    if kind == "van":
        first = head - 0.75
    spaced = [first, first - 0.85, first - 1.75]
    count = 1 if doors == 2 and kind != "van" else 3
    return tuple(y for y in spaced[:count] if y > rear + 0.22)


KINDS: dict[str, tuple[Callable[[np.random.Generator], CarPlan], float]] = {
    "sedan": (_sedan, 0.26),
    "hatchback": (_hatchback, 0.2),
    "estate": (_estate, 0.1),
    "SUV": (_suv, 0.18),
    "pickup": (_pickup, 0.07),
    "van": (_van, 0.08),
    "coupe": (_coupe, 0.11),
}
"""How each kind's measures are drawn, and how often it comes."""
