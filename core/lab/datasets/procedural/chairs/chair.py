"""Procedural chairs: one chair per seed, built of labelled solids in metres and brought to ShapeNet's scale."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from core.lab.datasets.procedural.chairs.backs import back_rest, hoop, padded, panel, slats
from core.lab.datasets.procedural.chairs.bases import column, feet, legs, sled, star, wire_base
from core.lab.datasets.procedural.chairs.dimensions import ChairDimensions, sample_dimensions
from core.lab.datasets.procedural.chairs.seats import arms, bucket, seat, t_arms, upholstery
from core.lab.datasets.procedural.solids import Part, Shape, bar, moved, normalised_shape, rounded_path, shell, slab

LABELS = ("seat", "back", "legs", "arms", "cushion", "metal")
"""Labels that a texture must paint. Any texture fits any chair."""


def chair(seed: int) -> Shape:
    """Build the chair of a seed, deterministically."""
    generator = np.random.default_rng([seed, 7])
    kind = str(generator.choice(list(_KINDS), p=[share for _, share in _KINDS.values()]))
    parts = _KINDS[kind][0](generator)
    return normalised_shape(kind, parts)


def _four_leg(g: np.random.Generator) -> list[Part]:
    dims = sample_dimensions(g)
    parts = seat(g, dims) + legs(g, dims) + back_rest(g, dims)
    return parts + (arms(g, dims) if g.random() < 0.3 else [])


def _shell_chair(g: np.random.Generator) -> list[Part]:
    """Build one bent shell for seat and back, on legs, a sled or a column."""
    dims = sample_dimensions(g, thick=0.02)
    bases = (legs, sled, column, wire_base)
    base = bases[g.choice(4, p=(0.35, 0.15, 0.3, 0.2))]
    return bucket(g, dims) + base(g, replace(dims, width=0.8 * dims.width, depth=0.85 * dims.depth))


def _sled_chair(g: np.random.Generator) -> list[Part]:
    dims = sample_dimensions(g, curve=g.uniform(0, 0.03))
    backs = (panel, padded, slats)
    parts = seat(g, dims) + backs[g.integers(3)](g, dims) + sled(g, dims)
    return parts + (arms(g, dims) if g.random() < 0.3 else [])


def _pedestal(g: np.random.Generator) -> list[Part]:
    dims = sample_dimensions(g, corner=0.2)
    backs = (panel, padded, hoop)
    parts = seat(g, dims) + column(g, dims) + backs[g.integers(3)](g, dims)
    return parts + (arms(g, dims) if g.random() < 0.25 else [])


def _swivel(g: np.random.Generator) -> list[Part]:
    dims = sample_dimensions(
        g, height=g.uniform(0.43, 0.54), width=g.uniform(0.46, 0.54), back=g.uniform(0.35, 0.75), corner=0.1
    )
    gap = g.uniform(0.02, 0.14) if dims.back < 0.6 else 0.02
    parts = upholstery(g, dims, g.uniform(0.06, 0.11)) + star(g, dims) + padded(g, dims, gap)
    spine = [(0, -0.1, -dims.thick - 0.02), (0, -0.02, -0.09), (0, 0.06, -0.05), (0, dims.back * 0.5, -0.04)]
    flat = bar(rounded_path([(0, up, out) for _, up, out in spine]), 0.07, 0.02)
    parts.append(Part("metal", dims.upright(flat), "back"))
    return parts + (t_arms(g, dims) if g.random() < 0.65 else [])


def _armchair(g: np.random.Generator) -> list[Part]:
    """Build blocks of upholstery: base, cushion, back and two arms."""
    width, depth, high = g.uniform(0.5, 0.68), g.uniform(0.5, 0.62), g.uniform(0.38, 0.45)
    dims = ChairDimensions(width, depth, high, 0.2, g.uniform(0.34, 0.62), g.uniform(0.1, 0.3), g.uniform(0, 0.05))
    foot = g.uniform(0.03, 0.16)
    arm, thick = g.uniform(0.08, 0.2), g.uniform(0.12, 0.2)
    cushion = g.uniform(0.1, 0.16)
    base = slab(width + 0.02, depth + thick, high - foot - cushion, 0.03, 0.02)
    parts = [Part("cushion", moved(base, (0, -thick / 2, (high - cushion + foot) / 2)), "seat")]
    pad = slab(width - 0.01, depth, cushion, 0.06, 0.05, dome=g.uniform(0.0, 0.03))
    parts.append(Part("cushion", moved(pad, (0, 0.02, high - cushion / 2)), "seat"))
    back = slab(width + (arm if g.random() < 0.5 else -0.02), dims.back + 0.1, thick, g.uniform(0.04, 0.15), 0.06)
    parts.append(Part("cushion", dims.upright(moved(back, (0, dims.back / 2 - 0.05, -0.3 * thick))), "back"))
    rise, long = g.uniform(0.1, 0.26), depth + thick * 0.8
    for side in (-1, 1):
        block = slab(arm, long, high - foot + rise, 0.04, min(0.045, arm * 0.45))
        place = (side * (width + arm) / 2, -0.4 * thick, (high + foot + rise) / 2)
        parts.append(Part("cushion", moved(block, place), "arms"))
    wide = replace(dims, width=width + 1.4 * arm, depth=depth + 0.6 * thick, height=foot + 0.03, thick=0.03)
    return parts + feet(g, wide, -0.2 * thick)


def _tub(g: np.random.Generator) -> list[Part]:
    """Build a thick shell around a round cushion."""
    radius, high, foot = g.uniform(0.3, 0.38), g.uniform(0.38, 0.44), g.uniform(0.05, 0.22)
    back, arm, thick = g.uniform(0.3, 0.5), g.uniform(0.12, 0.26), g.uniform(0.05, 0.11)
    angle, way = np.meshgrid(np.linspace(-0.12 * math.pi, 1.12 * math.pi, 36), np.linspace(0, 1, 8))
    share = np.clip(np.sin(angle), 0, 1) ** g.uniform(1.0, 4.0)
    top = high + arm + (back - arm) * share
    z = foot + 0.03 + (top - foot - 0.03) * way
    lean = 1 + g.uniform(0.05, 0.3) * way * (0.4 + 0.6 * share)
    squash = g.uniform(0.85, 1.1)
    sheet = np.stack((radius * lean * np.cos(angle), -radius * squash * lean * np.sin(angle), z), -1)
    parts = [Part("cushion", shell(sheet[:, ::-1], thick), "back")]
    under = slab(1.9 * radius, 1.9 * radius * squash, high - foot - 0.1, radius * 0.85, 0.03)
    parts.append(Part("seat", moved(under, (0, 0.01, (high + foot - 0.1) / 2)), "seat"))
    pad = slab(1.9 * radius, 1.95 * radius * squash, 0.13, radius * 0.85, 0.05, dome=0.02)
    parts.append(Part("cushion", moved(pad, (0, 0.02, high - 0.06)), "seat"))
    dims = ChairDimensions(1.6 * radius, 1.6 * radius * squash, foot + 0.03, 0.03, back)
    return parts + (feet(g, dims, 0.0) if foot < 0.16 or g.random() < 0.6 else column(g, dims))


def _lounge(g: np.random.Generator) -> list[Part]:
    """Build a low wooden frame with arms and loose cushions."""
    dims = sample_dimensions(g, height=g.uniform(0.34, 0.4), width=g.uniform(0.52, 0.64), back=g.uniform(0.4, 0.6))
    dims = replace(dims, recline=g.uniform(0.25, 0.5), curve=0.0, depth=g.uniform(0.5, 0.6), thick=0.04)
    parts = upholstery(g, dims, g.uniform(0.1, 0.14)) + legs(g, dims) + arms(g, dims)
    pad = slab(dims.width - 0.06, dims.back, g.uniform(0.09, 0.14), 0.04, 0.045)
    parts.append(Part("cushion", dims.upright(moved(pad, (0, dims.back / 2 + 0.04, 0.07))), "back"))
    return parts + slats(g, dims)


def _bar_chair(g: np.random.Generator) -> list[Part]:
    width = g.uniform(0.34, 0.42)
    dims = sample_dimensions(g, height=g.uniform(0.62, 0.8), width=width, back=g.uniform(0.15, 0.4))
    dims = replace(dims, depth=width * g.uniform(0.9, 1.05), corner=g.choice((0.04, width / 2)))
    parts = seat(g, dims) + (legs(g, dims, bars=2) if g.random() < 0.65 else column(g, dims, ring=True))
    return parts + (back_rest(g, dims) if g.random() < 0.6 else [])


def _stool(g: np.random.Generator) -> list[Part]:
    width = g.uniform(0.32, 0.44)
    dims = sample_dimensions(g, height=g.uniform(0.4, 0.68), width=width)
    dims = replace(dims, depth=width * g.uniform(0.85, 1.0), corner=g.choice((0.03, width / 2)), taper=0.0)
    return seat(g, dims) + (legs(g, dims) if g.random() < 0.8 else column(g, dims))


_KINDS: dict[str, tuple[Callable[[np.random.Generator], list[Part]], float]] = {
    "four-leg": (_four_leg, 0.3),
    "shell": (_shell_chair, 0.11),
    "sled": (_sled_chair, 0.08),
    "pedestal": (_pedestal, 0.06),
    "swivel": (_swivel, 0.12),
    "armchair": (_armchair, 0.09),
    "tub": (_tub, 0.06),
    "lounge": (_lounge, 0.05),
    "bar chair": (_bar_chair, 0.07),
    "stool": (_stool, 0.06),
}  # builder and probability of each kind
