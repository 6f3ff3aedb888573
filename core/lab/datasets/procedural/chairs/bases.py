"""Bases of seats: legs, bent tubes, wires, a column, an office chair's star."""

import math

import numpy as np

from core.lab.datasets.procedural.chairs.dimensions import ChairDimensions
from core.lab.datasets.procedural.solids import (
    Part,
    Point,
    Solid,
    bar,
    belongs_to,
    line,
    moved,
    rounded_path,
    slab,
    tube,
)


@belongs_to("legs")
def legs(g: np.random.Generator, dims: ChairDimensions, bars: int | None = None) -> list[Part]:
    """Build four legs, straight or splayed, with or without apron and stretchers."""
    inset, splay = g.uniform(0.025, 0.05), g.choice((0.0, g.uniform(0.02, 0.09)))
    style = g.choice(("square", "tapered", "round", "turned", "thin"), p=(0.3, 0.2, 0.2, 0.12, 0.18))
    thick = {"thin": g.uniform(0.016, 0.024)}.get(str(style), g.uniform(0.03, 0.052))
    top = dims.height - dims.thick
    parts, lines = [], {}
    for x, y in ((-1, 1), (1, 1), (1, -1), (-1, -1)):
        narrow = 1 - dims.taper if y < 0 else 1.0
        head = np.array([x * (dims.width / 2 - inset) * narrow, y * (dims.depth / 2 - inset), top])
        foot = np.array([head[0] + x * splay, head[1] + y * splay * (1.0 if y > 0 else 1.3), 0.0])
        lines[x, y] = (head, foot)
        parts.append(Part("legs", _leg(str(style), head, foot, thick)))
    if style in ("square", "tapered") and g.random() < 0.7:
        parts += _rails(lines, 0.04 / top, "box", 0.02, g.uniform(0.04, 0.07))
    bars = int(g.choice((0, 0, 1, 2))) if bars is None else bars
    for level in np.linspace(0.6, 0.78, bars):
        parts += _rails(lines, level, str(g.choice(("box", "h", "sides"))), 0.5 * thick, 0.5 * thick)
    return parts


def _leg(style: str, head: Point, foot: Point, thick: float) -> Solid:
    if style in ("square", "tapered"):
        return bar(line(head, foot, 5), thick, thick, end=1.0 if style == "square" else 0.55)
    way = np.linspace(0, 1, 25)
    if style == "turned":
        swell = 1 + 0.22 * np.cos(2 * math.pi * 3 * way) * np.sin(math.pi * way)
        return tube(line(head, foot, 25), list(0.5 * thick * swell * (1.1 - 0.4 * way)))
    return tube(line(head, foot, 25), list(0.5 * thick * (1 - (0.4 * way if style == "round" else 0 * way))))


def _rails(
    lines: dict[tuple[int, int], tuple[Point, Point]], level: float, kind: str, wide: float, tall: float
) -> list[Part]:
    """Build bars between the legs at a fraction ``level`` of the way down: a box, the two sides, or an H."""
    at = {corner: head + level * (foot - head) for corner, (head, foot) in lines.items()}
    pairs = [(at[-1, 1], at[-1, -1]), (at[1, 1], at[1, -1])]
    if kind == "box":
        pairs += [(at[-1, 1], at[1, 1]), (at[-1, -1], at[1, -1])]
    if kind == "h":
        pairs += [((at[-1, 1] + at[-1, -1]) / 2, (at[1, 1] + at[1, -1]) / 2)]
    return [Part("legs", bar(line(start, end), tall, wide, side=(0, 0, 1))) for start, end in pairs]


@belongs_to("legs")
def feet(g: np.random.Generator, dims: ChairDimensions, shift: float) -> list[Part]:
    """Build short legs under upholstery."""
    thick, splay = g.uniform(0.03, 0.06), g.choice((0.0, 0.02))
    ends = [(x * (dims.width / 2 - 0.05), y * (dims.depth / 2 - 0.05) + shift) for x in (-1, 1) for y in (-1, 1)]
    paths = [line((x, y, dims.height), (x + splay * np.sign(x), y + splay * np.sign(y), 0), 5) for x, y in ends]
    return [Part("legs", bar(path, thick, thick, end=0.6)) for path in paths]


@belongs_to("legs")
def sled(g: np.random.Generator, dims: ChairDimensions) -> list[Part]:
    """Build bent tubes: a cantilever, or a loop on each side."""
    x, front, rear = dims.width / 2 - 0.02, dims.depth / 2 - 0.02, -dims.depth / 2
    top, radius = dims.height - dims.thick - 0.012, g.uniform(0.01, 0.016)
    if g.random() < 0.5:
        corners = [(x, rear, top), (x, front, top), (x, front, radius), (x, rear, radius)]
        corners += [(-a, b, c) for a, b, c in reversed(corners)]
        return [Part("legs", tube(rounded_path(corners, cut=0.12), radius, 10))]
    lean = g.uniform(0.0, 0.06)
    corners = [(x, 0, top), (x, front - 0.04, top), (x, front + lean, radius), (x, rear - lean, radius)]
    corners += [(x, rear + 0.04, top), (x, 0, top)]
    loops = [rounded_path([(s * a, b, c) for a, b, c in corners], cut=0.12) for s in (-1, 1)]
    cross = tube(line((-x, front - 0.06, top), (x, front - 0.06, top)), radius, 10)
    return [Part("legs", tube(loop, radius, 10)) for loop in loops] + [Part("legs", cross)]


@belongs_to("legs")
def wire_base(g: np.random.Generator, dims: ChairDimensions) -> list[Part]:
    """Build thin rods that run crosswise from under the seat to the four feet."""
    x, y, top = dims.width / 2, dims.depth / 2, dims.height - dims.thick - 0.02
    radius, reach = g.uniform(0.006, 0.01), g.uniform(0.5, 0.9)
    parts = []
    for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        for fork in (0.25, 0.7):
            head = (a * x * fork, b * y * (0.95 - fork) * reach, top)
            parts.append(Part("legs", tube(line(head, (a * x, b * y, 0)), radius, 8)))
    for a in (-1, 1):
        rail = line((a * x * 0.8, -y * 0.8, top), (a * x * 0.8, y * 0.8, top))
        parts.append(Part("legs", tube(rail, 1.3 * radius, 8)))
    return parts


@belongs_to("legs")
def column(g: np.random.Generator, dims: ChairDimensions, ring: bool = False) -> list[Part]:
    """Build a column on a trumpet foot, a disc or a flat cross."""
    top, wide = dims.height - dims.thick, 0.5 * max(dims.width, 0.42)
    thick = g.uniform(0.02, 0.035)
    kind = g.integers(3)
    if kind == 0:
        way = np.linspace(0, 1, 24)
        radius = thick + (wide - thick) * np.exp(-way * top / 0.045) + (0.06 * way**8)
        parts = [Part("legs", tube(line((0, 0, 0), (0, 0, top), 24), list(radius), 28))]
    else:
        parts = [Part("metal", tube(line((0, 0, 0.01), (0, 0, top)), thick, 16))]
        if kind == 1:
            disc = slab(2 * wide, 2 * wide, 0.025, wide, 0.01)
            parts.append(Part("metal", moved(disc, (0, 0, 0.0125))))
        else:
            parts += _spokes(4, wide * 1.1, 0.06, 0.012, math.pi / 4)
        parts.append(Part("metal", moved(slab(0.2, 0.2, 0.02, 0.03, 0.005), (0, 0, top - 0.008))))
    if ring:
        angle = np.linspace(0, 2 * math.pi, 33)
        circle = np.stack((0.17 * np.cos(angle), 0.17 * np.sin(angle), np.full_like(angle, 0.35 * top)), -1)
        parts.append(Part("metal", tube(circle, 0.011, 8)))
        parts += [Part("metal", tube(line((-0.17, 0, 0.35 * top), (0.17, 0, 0.35 * top)), 0.009, 8))]
    return parts


@belongs_to("legs")
def star(g: np.random.Generator, dims: ChairDimensions) -> list[Part]:
    """Build an office chair's five spokes on castors, gas lift and plate."""
    reach = g.uniform(0.27, 0.33)
    parts = _spokes(5, reach, 0.1, 0.06, math.pi / 2)
    top = dims.height - dims.thick
    parts.append(Part("metal", tube(line((0, 0, 0.06), (0, 0, top)), 0.028, 14)))
    parts.append(Part("metal", moved(slab(0.24, 0.24, 0.03, 0.03, 0.006), (0, 0, top - 0.06))))
    for i in range(5):
        a = 2 * math.pi * i / 5 + math.pi / 2
        x, y, dx, dy = reach * math.cos(a), reach * math.sin(a), 0.022 * -math.sin(a), 0.022 * math.cos(a)
        parts.append(Part("metal", tube(line((x - dx, y - dy, 0.028), (x + dx, y + dy, 0.028)), 0.028, 12)))
    return parts


def _spokes(count: int, reach: float, hub: float, tip: float, start: float) -> list[Part]:
    """Build tapered arms from the hub's height (m) out to the tip's."""
    parts = []
    for i in range(count):
        a = 2 * math.pi * i / count + start
        c, s = math.cos(a), math.sin(a)
        path = line((0, 0, hub), (reach * c, reach * s, tip), 4)
        parts.append(Part("legs", bar(path, 0.05, 0.03, end=0.6, side=(-s, c, 0))))
    return parts
