"""Back rests: drawn flat as (x, up, towards the sitter), m, then bent by ``Plan.upright``."""

from collections.abc import Sequence

import numpy as np

from core.datasets.procedural.chairs.dimensions import Plan
from core.datasets.procedural.solids import Part, Solid, bar, line, moved, rounded_path, slab, tube


def back_rest(g: np.random.Generator, plan: Plan) -> list[Part]:
    """Any back rest that a wooden chair may have."""
    styles = (slats, _ladder, panel, padded, hoop, _cross)
    return styles[g.choice(6, p=(0.2, 0.18, 0.22, 0.2, 0.12, 0.08))](g, plan)


def _flat(plan: Plan, label: str, solids: Sequence[Solid]) -> list[Part]:
    return [Part(label, plan.upright(solid)) for solid in solids]


def _posts(g: np.random.Generator, plan: Plan, top: float | None = None) -> tuple[float, list[Solid]]:
    """The two uprights, and how far from the middle they stand."""
    x = (plan.width / 2 - 0.03) * (1 - plan.taper)
    thick, up = g.uniform(0.025, 0.042), plan.back if top is None else top
    return x, [bar(line((s * x, -plan.thick, 0), (s * x, up, 0), 8), thick, thick) for s in (-1, 1)]


def _supports(plan: Plan, x: float, top: float, out: float) -> list[Part]:
    """Two flat bars at -x and x that carry a back rest, ``out`` m before its middle layer."""
    paths = [line((s * x, -plan.thick, out), (s * x, top, out), 6) for s in (-1, 1)]
    return _flat(plan, "legs", [bar(path, 0.03, 0.02) for path in paths])


def _cross_bar(x: float, up: float, tall: float, thick: float = 0.018) -> Solid:
    return bar(line((-x, up, 0), (x, up, 0), 12), tall, thick, side=(0, 1, 0))


def slats(g: np.random.Generator, plan: Plan) -> list[Part]:
    """Upright slats between two rails."""
    x, posts = _posts(g, plan)
    count, tall = int(g.integers(3, 8)), g.uniform(0.04, 0.09)
    low = g.uniform(0.05, 0.15)
    rails = [_cross_bar(x, plan.back - tall / 2, tall, 0.024), _cross_bar(x, low, 0.035)]
    wide = min(g.uniform(0.015, 0.06), 1.4 * x / count)
    middle = np.linspace(-x, x, count + 2)[1:-1]
    slats = [bar(line((s, low, 0), (s, plan.back - tall / 2, 0), 6), wide, 0.012) for s in middle]
    return _flat(plan, "back", posts + rails + slats)


def _ladder(g: np.random.Generator, plan: Plan) -> list[Part]:
    x, posts = _posts(g, plan)
    count = int(g.integers(1, 5))
    tall = min(g.uniform(0.04, 0.12), 0.6 * plan.back / count)
    heights = np.linspace(plan.back - tall / 2, plan.back * g.uniform(0.3, 0.6), count)
    return _flat(plan, "back", posts + [_cross_bar(x, up, tall) for up in heights])


def _cross(g: np.random.Generator, plan: Plan) -> list[Part]:
    x, posts = _posts(g, plan)
    tall, low = g.uniform(0.04, 0.08), g.uniform(0.06, 0.12)
    high = plan.back - tall / 2
    bars = [bar(line((s * x, low, 0), (-s * x, high, 0), 8), 0.024, 0.014) for s in (-1, 1)]
    return _flat(plan, "back", [*posts, _cross_bar(x, high, tall, 0.024), _cross_bar(x, low, 0.035), *bars])


def panel(g: np.random.Generator, plan: Plan) -> list[Part]:
    """A bent board, down to the seat or held up by posts; its corners up to fully round."""
    gap = g.choice((-0.02, g.uniform(0.08, 0.2)))
    gap = min(float(gap), 0.5 * plan.back)
    tall, wide = plan.back - gap, plan.width * g.uniform(0.82, 1.02) * (1 - plan.taper)
    corner = g.choice((0.02, g.uniform(0.05, 0.15), 0.5 * min(tall, wide)))
    board = slab(wide, tall, g.uniform(0.015, 0.03), corner, 0.008, -0.3 * plan.taper)
    parts = _flat(plan, "back", [moved(board, (0, gap + tall / 2, 0))])
    if gap > 0:
        parts += _supports(plan, 0.35 * wide, gap + 0.5 * tall, -0.015)
    return parts


def padded(g: np.random.Generator, plan: Plan, gap: float | None = None) -> list[Part]:
    """An upholstered back, on two posts, or framed by them."""
    framed = gap is None and g.random() < 0.4
    lift = float(g.choice((0.02, g.uniform(0.08, 0.18)))) if gap is None else gap
    lift = min(lift, 0.5 * plan.back)
    wide, tall = plan.width * g.uniform(0.84, 0.98) * (1 - plan.taper), plan.back - lift
    thick = g.uniform(0.035, 0.075)
    corner = g.choice((0.03, g.uniform(0.05, 0.14), 0.45 * min(tall, wide)))
    if framed:
        x, posts = _posts(g, plan)
        frame = [*posts, _cross_bar(x, plan.back - 0.02, 0.04, 0.026), _cross_bar(x, lift, 0.035, 0.022)]
        pad = slab(2 * x - 0.01, tall - 0.03, thick, 0.02, 0.35 * thick)
        inside = moved(pad, (0, lift + tall / 2 - 0.01, 0.01))
        return _flat(plan, "back", frame) + _flat(plan, "cushion", [inside])
    pad = moved(slab(wide, tall, thick, corner, 0.42 * thick, -0.5 * plan.taper), (0, lift + tall / 2, 0))
    held = gap is None and lift > 0.03
    return _flat(plan, "cushion", [pad]) + (_supports(plan, 0.3 * wide, lift + 0.06, 0.0) if held else [])


def hoop(g: np.random.Generator, plan: Plan) -> list[Part]:
    """Windsor: a bent hoop with spindles in it, or a thonet's second hoop."""
    x = (plan.width / 2 - 0.025) * (1 - plan.taper)
    corners = [(-x, -plan.thick, 0), (-x * 1.08, plan.back * 0.7, 0), (-x * 0.7, plan.back, 0)]
    corners += [(-a, b, c) for a, b, c in reversed(corners)]
    path, radius = rounded_path(corners), g.uniform(0.011, 0.016)
    solids = [tube(path, radius, 10)]
    if g.random() < 0.35:
        inner = path * (0.58, 0.76, 1)
        return _flat(plan, "back", [*solids, tube(inner, 0.8 * radius, 10)])
    for s in np.linspace(-x, x, int(g.integers(4, 9)) + 2)[1:-1]:
        half = path[len(path) // 2 :] if s > 0 else path[: len(path) // 2 + 1]
        top = half[np.abs(half[:, 0] - s).argmin() if abs(s) < x * 0.98 else 0][1]
        solids.append(tube(line((s * 0.85, -0.01, 0), (s, top, 0), 6), 0.007, 8))
    return _flat(plan, "back", solids)
