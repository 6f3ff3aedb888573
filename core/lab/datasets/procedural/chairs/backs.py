"""Back rests: built flat as (x, up, towards the sitter), m, then bent by ``ChairDimensions.upright``."""

from collections.abc import Sequence

import numpy as np

from core.lab.datasets.procedural.chairs.dimensions import ChairDimensions
from core.lab.datasets.procedural.solids import Part, Solid, bar, belongs_to, line, moved, rounded_path, slab, tube


@belongs_to("back")
def back_rest(g: np.random.Generator, dims: ChairDimensions) -> list[Part]:
    """Build a random back rest of a wooden chair."""
    styles = (slats, _ladder, panel, padded, hoop, _cross)
    return styles[g.choice(6, p=(0.2, 0.18, 0.22, 0.2, 0.12, 0.08))](g, dims)


def _flat(dims: ChairDimensions, label: str, solids: Sequence[Solid]) -> list[Part]:
    return [Part(label, dims.upright(solid)) for solid in solids]


def _posts(g: np.random.Generator, dims: ChairDimensions) -> tuple[float, list[Solid]]:
    """Return the two uprights and their distance from the middle."""
    x = (dims.width / 2 - 0.03) * (1 - dims.taper)
    thick = g.uniform(0.025, 0.042)
    return x, [bar(line((s * x, -dims.thick, 0), (s * x, dims.back, 0), 8), thick, thick) for s in (-1, 1)]


def _supports(dims: ChairDimensions, x: float, top: float, out: float) -> list[Part]:
    """Build two flat bars at -x and x behind a back rest, ``out`` m in front of its middle."""
    paths = [line((s * x, -dims.thick, out), (s * x, top, out), 6) for s in (-1, 1)]
    return _flat(dims, "legs", [bar(path, 0.03, 0.02) for path in paths])


def _cross_bar(x: float, up: float, tall: float, thick: float = 0.018) -> Solid:
    return bar(line((-x, up, 0), (x, up, 0), 12), tall, thick, side=(0, 1, 0))


@belongs_to("back")
def slats(g: np.random.Generator, dims: ChairDimensions) -> list[Part]:
    """Build upright slats between two rails."""
    x, posts = _posts(g, dims)
    count, tall = int(g.integers(3, 8)), g.uniform(0.04, 0.09)
    low = g.uniform(0.05, 0.15)
    rails = [_cross_bar(x, dims.back - tall / 2, tall, 0.024), _cross_bar(x, low, 0.035)]
    wide = min(g.uniform(0.015, 0.06), 1.4 * x / count)
    middle = np.linspace(-x, x, count + 2)[1:-1]
    slats = [bar(line((s, low, 0), (s, dims.back - tall / 2, 0), 6), wide, 0.012) for s in middle]
    return _flat(dims, "back", posts + rails + slats)


def _ladder(g: np.random.Generator, dims: ChairDimensions) -> list[Part]:
    x, posts = _posts(g, dims)
    count = int(g.integers(1, 5))
    tall = min(g.uniform(0.04, 0.12), 0.6 * dims.back / count)
    heights = np.linspace(dims.back - tall / 2, dims.back * g.uniform(0.3, 0.6), count)
    return _flat(dims, "back", posts + [_cross_bar(x, up, tall) for up in heights])


def _cross(g: np.random.Generator, dims: ChairDimensions) -> list[Part]:
    x, posts = _posts(g, dims)
    tall, low = g.uniform(0.04, 0.08), g.uniform(0.06, 0.12)
    high = dims.back - tall / 2
    bars = [bar(line((s * x, low, 0), (-s * x, high, 0), 8), 0.024, 0.014) for s in (-1, 1)]
    return _flat(dims, "back", [*posts, _cross_bar(x, high, tall, 0.024), _cross_bar(x, low, 0.035), *bars])


@belongs_to("back")
def panel(g: np.random.Generator, dims: ChairDimensions) -> list[Part]:
    """Build a bent board, down to the seat or on posts, with corners from square to fully round."""
    gap = g.choice((-0.02, g.uniform(0.08, 0.2)))
    gap = min(float(gap), 0.5 * dims.back)
    tall, wide = dims.back - gap, dims.width * g.uniform(0.82, 1.02) * (1 - dims.taper)
    corner = g.choice((0.02, g.uniform(0.05, 0.15), 0.5 * min(tall, wide)))
    board = slab(wide, tall, g.uniform(0.015, 0.03), corner, 0.008, -0.3 * dims.taper)
    parts = _flat(dims, "back", [moved(board, (0, gap + tall / 2, 0))])
    if gap > 0:
        parts += _supports(dims, 0.35 * wide, gap + 0.5 * tall, -0.015)
    return parts


@belongs_to("back")
def padded(g: np.random.Generator, dims: ChairDimensions, gap: float | None = None) -> list[Part]:
    """Build an upholstered back, on two posts or framed by them."""
    framed = gap is None and g.random() < 0.4
    lift = float(g.choice((0.02, g.uniform(0.08, 0.18)))) if gap is None else gap
    lift = min(lift, 0.5 * dims.back)
    wide, tall = dims.width * g.uniform(0.84, 0.98) * (1 - dims.taper), dims.back - lift
    thick = g.uniform(0.035, 0.075)
    corner = g.choice((0.03, g.uniform(0.05, 0.14), 0.45 * min(tall, wide)))
    if framed:
        x, posts = _posts(g, dims)
        frame = [*posts, _cross_bar(x, dims.back - 0.02, 0.04, 0.026), _cross_bar(x, lift, 0.035, 0.022)]
        pad = slab(2 * x - 0.01, tall - 0.03, thick, 0.02, 0.35 * thick)
        inside = moved(pad, (0, lift + tall / 2 - 0.01, 0.01))
        return _flat(dims, "back", frame) + _flat(dims, "cushion", [inside])
    pad = moved(slab(wide, tall, thick, corner, 0.42 * thick, -0.5 * dims.taper), (0, lift + tall / 2, 0))
    held = gap is None and lift > 0.03
    return _flat(dims, "cushion", [pad]) + (_supports(dims, 0.3 * wide, lift + 0.06, 0.0) if held else [])


@belongs_to("back")
def hoop(g: np.random.Generator, dims: ChairDimensions) -> list[Part]:
    """Build a Windsor hoop with spindles, or a Thonet's double hoop."""
    x = (dims.width / 2 - 0.025) * (1 - dims.taper)
    corners = [(-x, -dims.thick, 0), (-x * 1.08, dims.back * 0.7, 0), (-x * 0.7, dims.back, 0)]
    corners += [(-a, b, c) for a, b, c in reversed(corners)]
    path, radius = rounded_path(corners), g.uniform(0.011, 0.016)
    solids = [tube(path, radius, 10)]
    if g.random() < 0.35:
        inner = path * (0.58, 0.76, 1)
        return _flat(dims, "back", [*solids, tube(inner, 0.8 * radius, 10)])
    for s in np.linspace(-x, x, int(g.integers(4, 9)) + 2)[1:-1]:
        half = path[len(path) // 2 :] if s > 0 else path[: len(path) // 2 + 1]
        top = half[np.abs(half[:, 0] - s).argmin() if abs(s) < x * 0.98 else 0][1]
        solids.append(tube(line((s * 0.85, -0.01, 0), (s, top, 0), 6), 0.007, 8))
    return _flat(dims, "back", solids)
