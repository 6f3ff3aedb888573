"""Random dimensions for each kind of car."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from core.lab.datasets.procedural.cars.dimensions import CarDimensions


def sample_dimensions(g: np.random.Generator, kind: str) -> CarDimensions:
    """Sample a car's dimensions. Raises ``KeyError`` for an unknown kind."""
    return KINDS[kind][0](g)


def _sedan(g: np.random.Generator) -> CarDimensions:
    deck, size = g.uniform(0.4, 0.75), {"length": g.uniform(4.25, 5.05), "height": g.uniform(1.4, 1.5)}
    if g.random() < 0.25:
        return _notchback(g, "sedan", deck + 0.15, g.uniform(0.3, 0.5), **size, **_angular(g))
    return _notchback(g, "sedan", deck, g.uniform(0.5, 0.8), **size)


def _angular(g: np.random.Generator) -> dict[str, float]:
    """Sample the boxy shape of older cars and some off-road cars."""
    return {
        "screen": g.uniform(0.35, 0.55),
        "cut": g.uniform(0.045, 0.065),
        "tumble": g.uniform(0.1, 0.2),
        "narrow": g.uniform(0.03, 0.07),
        "bow": g.uniform(0.06, 0.14),
        "nose": g.uniform(0.84, 0.92),
    }


def _coupe(g: np.random.Generator) -> CarDimensions:
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


def _notchback(g: np.random.Generator, kind: str, deck: float, run: float, **given: float) -> CarDimensions:
    """Build a car with a boot lid."""
    m = _measures(g, **given)
    rear, tail = -m["length"] / 2, m["cowl"] + g.uniform(0.0, 0.09)
    head = m["length"] / 2 - m["overhang"] - m["cowl_back"] - m["screen"]
    roof_end = min(rear + deck + run, head - 0.55)
    lid = [(rear + deck, tail), (rear + 0.05, tail - g.uniform(0.0, 0.05)), (rear, 0.72 * tail)]
    glass = (tail + 0.05, m["height"] - 0.09)
    return _finished(kind, m, lid, roof_end, 0.78 * tail, glass, rear + deck + 0.12)


def _hatchback(g: np.random.Generator) -> CarDimensions:
    """Sample city cars up to tall family cars with a windscreen far in front."""
    m = _measures(
        g,
        length=g.uniform(3.2, 4.35),
        width=g.uniform(1.62, 1.82),
        height=g.uniform(1.42, 1.62),
        cowl_back=g.uniform(-0.05, 0.4),
        screen=g.uniform(0.55, 0.95),
        front=g.uniform(0.185, 0.205),
        basis=g.uniform(0.6, 0.64),
        doors=g.choice((2.0, 4.0)),
        droop=g.uniform(0.0, 0.1),
    )
    return _tailgated(g, "hatchback", m, g.uniform(0.25, 0.8))


def _estate(g: np.random.Generator) -> CarDimensions:
    m = _measures(g, length=g.uniform(4.4, 4.95), height=g.uniform(1.43, 1.53))
    return _tailgated(g, "estate", m, g.uniform(0.25, 0.6))


def _suv(g: np.random.Generator) -> CarDimensions:
    boxy = g.random() < 0.35
    size = {
        "length": g.uniform(4.0, 4.95),
        "width": g.uniform(1.78, 1.98),
        "height": g.uniform(1.62, 1.95),
        "clearance": g.uniform(0.2, 0.3),
        "wheel": g.uniform(0.35, 0.41),
        "nose": g.uniform(0.84, 0.92),
    }
    if boxy:
        return _tailgated(g, "SUV", _measures(g, **(size | _angular(g))), g.uniform(0.06, 0.15))
    return _tailgated(g, "SUV", _measures(g, **size, tumble=g.uniform(0.18, 0.3)), g.uniform(0.25, 0.7))


def _tailgated(g: np.random.Generator, kind: str, m: Mapping[str, float], run: float) -> CarDimensions:
    """Build a car whose roof continues to the tailgate."""
    rear, tail = -m["length"] / 2, m["cowl"] + g.uniform(-0.04, 0.06)
    roof_end, glass = rear + run + 0.07, (tail + 0.04, m["height"] - g.uniform(0.1, 0.14))
    gate = [(rear + 0.07, tail), (rear + 0.02, 0.85 * tail), (rear, 0.6 * tail)]
    third = g.random() < 0.7 and kind != "hatchback"
    return _finished(kind, m, gate, roof_end, 0.8 * tail, glass, rear + (0.35 if third else 0.75))


def _van(g: np.random.Generator) -> CarDimensions:
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


def _pickup(g: np.random.Generator) -> CarDimensions:
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
    dims = _finished("pickup", m, gate, bed + g.uniform(0.1, 0.25), 0.85 * rail, glass, bed + 0.16)
    return replace(dims, bed=(bed - 0.04, rear + 0.08)) if g.random() < 0.8 else dims


def _measures(g: np.random.Generator, **given: float) -> dict[str, float]:
    """Sample an ordinary car's measures, some of them given."""
    length, height = given.get("length", 4.5), given.get("height", 1.45)
    cowl = given.get("cowl_height", height * g.uniform(0.62, 0.67))
    sampled = {
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
    measures = {name: float(value) for name, value in (sampled | given).items()}
    return measures | {"cowl": cowl, "overhang": length * measures["front"]}


def _finished(
    kind: str,
    m: Mapping[str, float],
    rear: list[tuple[float, float]],
    roof_end: float,
    tail: float,
    rear_glass: tuple[float, float] | None,
    side_glass: float,
) -> CarDimensions:
    """Combine the measures into dimensions; ``rear`` is the profile behind the roof."""
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
    dims = CarDimensions(
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
    # A wheel arch must stay below the bonnet.
    low = float(dims.shoulder(axle + np.array((-0.3, 0.0, 0.3))).min())
    return replace(dims, wheel=min(dims.wheel, 0.5 * (low - 0.12)))


def _pillars(doors: int, kind: str, cowl: float, head: float, rear: float) -> tuple[float, ...]:
    """Return y of the pillars between the side windows."""
    first = min(head - (0.65 if doors == 2 else 0.45), cowl - 0.95)
    if kind == "van":
        first = head - 0.75
    spaced = [first, first - 0.85, first - 1.75]
    count = 1 if doors == 2 and kind != "van" else 3
    return tuple(y for y in spaced[:count] if y > rear + 0.22)


KINDS: dict[str, tuple[Callable[[np.random.Generator], CarDimensions], float]] = {
    "sedan": (_sedan, 0.26),
    "hatchback": (_hatchback, 0.2),
    "estate": (_estate, 0.1),
    "SUV": (_suv, 0.18),
    "pickup": (_pickup, 0.07),
    "van": (_van, 0.08),
    "coupe": (_coupe, 0.11),
}  # sampler and probability of each kind
