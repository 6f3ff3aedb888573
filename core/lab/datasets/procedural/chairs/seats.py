"""Seats (boards, cushions, bent shells) and arm rests."""

import math

import numpy as np

from core.lab.datasets.procedural.chairs.dimensions import ChairDimensions
from core.lab.datasets.procedural.solids import Part, bar, belongs_to, line, moved, rounded_path, shell, slab, tube


@belongs_to("seat")
def seat(g: np.random.Generator, dims: ChairDimensions) -> list[Part]:
    """Build a board, bare (perhaps hollowed) or with a cushion, or full upholstery."""
    kind = g.choice(3, p=(0.45, 0.3, 0.25))
    if kind == 2:
        return upholstery(g, dims, g.uniform(0.05, 0.1))
    dip = -min(g.choice((0.0, g.uniform(0.005, 0.02))), 0.5 * dims.thick) if kind == 0 else 0.0
    board = slab(dims.width, dims.depth, dims.thick, dims.corner, 0.012, dims.taper, dome=dip)
    parts = [Part("seat", moved(board, (0, 0, dims.height - dims.thick / 2)))]
    if kind == 1:
        size = g.uniform(0.84, 0.96)
        thick = g.uniform(0.03, 0.06)
        pad = slab(dims.width * size, dims.depth * size, thick, dims.corner + 0.02, 0.02, dims.taper, dome=0.012)
        parts.append(Part("cushion", moved(pad, (0, 0.005, dims.height + thick * 0.45))))
    return parts


@belongs_to("seat")
def upholstery(g: np.random.Generator, dims: ChairDimensions, thick: float) -> list[Part]:
    """Build a thick cushion with its top at the seat's height, on a thin board."""
    corner = max(dims.corner, 0.04)
    pad = slab(dims.width, dims.depth, thick, corner, 0.42 * thick, dims.taper, dome=g.uniform(0.0, 0.02))
    board = slab(dims.width * 0.95, dims.depth * 0.95, 0.02, corner, 0.005, dims.taper)
    return [
        Part("cushion", moved(pad, (0, 0, dims.height - thick / 2 + 0.015))),
        Part("seat", moved(board, (0, 0, dims.height - thick))),
    ]


@belongs_to("shell")
def bucket(g: np.random.Generator, dims: ChairDimensions) -> list[Part]:
    """Build a bent shell: a profile from the front lip over the seat and up the back, with raised sides."""
    deep, high = dims.depth / 2, dims.height
    corners = [
        (deep, high - 0.02),
        (deep - 0.06, high),
        (-0.2 * deep, high - 0.025),
        (-deep, high + 0.01),
        (-deep - dims.recline * dims.back * 0.6, high + 0.55 * dims.back),
        (-deep - dims.recline * dims.back, high + dims.back),
    ]
    curve = rounded_path(corners, rounds=4)
    lengths = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))))
    # Rows crowd towards both ends, where the outline turns.
    way = 0.5 - 0.5 * np.cos(np.linspace(0, math.pi, 44))
    profile = np.stack([np.interp(way * lengths[-1], lengths, curve[:, i]) for i in (0, 1)], -1)
    tangent = np.gradient(profile, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    inward = np.stack((tangent[:, 1], -tangent[:, 0]), -1)
    lift, arm = g.uniform(0.02, 0.07), g.choice((0.0, g.uniform(0.05, 0.14)))
    lift = lift + arm * np.exp(-(((way - 0.5) / 0.17) ** 2))
    top, end = g.uniform(0.7, 1.05), g.uniform(3.0, 9.0)
    outline = (1 - np.abs(2 * way - 1) ** (2 * end)) ** 0.4
    share = np.maximum((1 + (top - 1) * way**2) * outline, 0.12)
    half, across = share * dims.width / 2, np.linspace(-1, 1, 21)
    raised = lift[:, None] * np.abs(share[:, None] * across) ** 2.5
    middle = profile[:, None] + inward[:, None] * raised[..., None]
    sheet = np.concatenate(((half[:, None] * across)[..., None], middle), -1)
    parts = [Part("seat", shell(sheet, g.uniform(0.012, 0.03)))]
    if g.random() < 0.35:
        pad = slab(dims.width * 0.72, dims.depth * 0.75, 0.03, 0.1, 0.014)
        parts.append(Part("cushion", moved(pad, (0, 0, high + 0.005))))
    return parts


@belongs_to("arms")
def arms(g: np.random.Generator, dims: ChairDimensions) -> list[Part]:
    """Build wooden arms on posts, or bent tubes, from the back rest to the seat's front."""
    rise, wide = g.uniform(0.17, 0.25), g.uniform(0.025, 0.06)
    rise = min(rise, 0.85 * dims.back)
    x = dims.width / 2 + 0.5 * wide - 0.01
    rear = float(dims.rear(np.array(x), np.array(rise)))
    front = dims.depth / 2 - g.uniform(0.02, 0.12)
    low, high = dims.height - dims.thick, dims.height + rise
    parts = []
    tubular = g.random() < 0.35
    for s in (-1, 1):
        if tubular:
            corners = [(s * x, rear, high), (s * x, front, high), (s * x, front, low)]
            parts.append(Part("arms", tube(rounded_path(corners, cut=0.15), 0.013, 10)))
            continue
        rest = line((s * x, rear - 0.02, high), (s * x, front + 0.03, high), 6)
        post = line((s * x, front, low - 0.04), (s * x, front, high), 3)
        parts += [Part("arms", bar(rest, wide, 0.026)), Part("legs", bar(post, 0.03, 0.035))]
    return parts


@belongs_to("arms")
def t_arms(g: np.random.Generator, dims: ChairDimensions) -> list[Part]:
    """Build an office chair's arms: pads on brackets from under the seat."""
    rise, x = g.uniform(0.17, 0.24), dims.width / 2 + 0.03
    low, high = dims.height - dims.thick - 0.03, dims.height + rise
    parts = []
    for s in (-1, 1):
        corners = [(s * 0.12, -0.02, low), (s * x, -0.02, low), (s * x, -0.02, high)]
        parts.append(Part("metal", bar(rounded_path(corners, cut=0.12), 0.05, 0.018, side=(0, 1, 0))))
        pad = slab(0.07, g.uniform(0.22, 0.28), 0.03, 0.03, 0.012)
        parts.append(Part("arms", moved(pad, (s * x, 0.0, high))))
    return parts
