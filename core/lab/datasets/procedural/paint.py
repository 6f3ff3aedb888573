"""Textures of chairs and paints of objects, independent of the shape."""

import colorsys
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

_TILE = 64  # px; in 128 px images a tile of 0.3 m covers about 20 px

_WOODS = ("c89b66", "dfc294", "7a4a2b", "96552f", "5b2d1c", "3a2a22", "e6d3b1", "b5793f", "a8663a", "d9a566")
_METALS = ("c4c6c8", "8d9196", "2a2b2e", "e4e4e0", "b99b5a", "55585c")
_LEATHERS = ("20201f", "4a2a1a", "7b4526", "a86b3c", "8e1f22", "d8cbb4", "2d3b36", "efece4")


@dataclass(frozen=True)
class Paint:
    """A tile that repeats every ``period`` m on a part."""

    tile: UInt8[np.ndarray, "height width 4"]  # sRGB and alpha
    period: float


def texture(seed: int) -> Mapping[str, Paint]:
    """Return the paint of each part label: seat, back, legs, arms, cushion, metal."""
    generator = np.random.default_rng([seed, 11])
    styles = (_wooden, _painted, _plastic, _leather, _upholstered)
    return styles[generator.choice(len(styles), p=(0.28, 0.18, 0.2, 0.12, 0.22))](generator)


def _wooden(g: np.random.Generator) -> Mapping[str, Paint]:
    wood = _wood(g)
    return _with_metal(g, seat=wood, back=wood, legs=wood, arms=wood, cushion=_fabric(g, any_colour(g)))


def _painted(g: np.random.Generator) -> Mapping[str, Paint]:
    paint = plain(any_colour(g))
    seat = _wood(g) if g.random() < 0.4 else paint
    back = seat if g.random() < 0.3 else paint
    return _with_metal(g, seat=seat, back=back, legs=paint, arms=back, cushion=_fabric(g, any_colour(g)))


def _plastic(g: np.random.Generator) -> Mapping[str, Paint]:
    body = plain(_vivid(g) if g.random() < 0.7 else any_colour(g))
    legs = (body, _metal(g), _wood(g), plain(from_hex("242424")))[g.integers(4)]
    cushion = body if g.random() < 0.5 else _fabric(g, _vivid(g))
    return _with_metal(g, seat=body, back=body, legs=legs, arms=body if g.random() < 0.6 else legs, cushion=cushion)


def _leather(g: np.random.Generator) -> Mapping[str, Paint]:
    hide = _speckled(g, from_hex(_LEATHERS[g.integers(len(_LEATHERS))]), 0.05, 0.22, 2.0)
    legs = (_metal(g), _wood(g))[g.integers(2)]
    return _with_metal(g, seat=hide, back=hide, legs=legs, arms=hide if g.random() < 0.5 else legs, cushion=hide)


def _upholstered(g: np.random.Generator) -> Mapping[str, Paint]:
    fabric = _fabric(g, any_colour(g))
    legs = (_wood(g), _metal(g), plain(from_hex("1e1e1e")))[g.integers(3)]
    second = _fabric(g, any_colour(g)) if g.random() < 0.3 else fabric
    arms = legs if g.random() < 0.5 else second
    return _with_metal(g, seat=fabric, back=second, legs=legs, arms=arms, cushion=fabric)


def _with_metal(g: np.random.Generator, **paints: Paint) -> Mapping[str, Paint]:
    return {**paints, "metal": _metal(g)}


def _wood(g: np.random.Generator) -> Paint:
    """Make streaks along z, with broad bands of darker wood."""
    colour = from_hex(_WOODS[g.integers(len(_WOODS))])
    streaks = _noise(g, 1.0, 14.0)
    bands = np.sin(2 * np.pi * (np.arange(_TILE) / _TILE * g.integers(2, 5) + 0.35 * _noise(g, 6.0, 16.0)))
    return _paint(colour * (1 + 0.09 * streaks + 0.08 * bands)[..., None], g.uniform(0.2, 0.35))


def _fabric(g: np.random.Generator, colour: Float[np.ndarray, "3"]) -> Paint:
    """Make a plain, mottled, striped, checked or dotted fabric."""
    kind = g.choice(5, p=(0.3, 0.25, 0.2, 0.15, 0.1))
    if kind < 2:
        return _speckled(g, colour, 0.07 if kind else 0.03, 0.25, 3.0 if kind else 1.0)
    own_tone = np.clip(colour * 0.55 + (0.4 if colour.mean() < 0.5 else 0.0), 0, 1)
    other = any_colour(g) if g.random() < 0.5 else own_tone
    wave = np.sin(2 * np.pi * np.arange(_TILE) / _TILE * 2)
    stripes = np.broadcast_to((wave > g.uniform(-0.4, 0.6)).astype(float), (_TILE, _TILE))
    dots = (wave[:, None] * wave > 0.3).astype(float)
    share = (stripes, 0.5 * (stripes + stripes.T), dots)[kind - 2]
    mixed = colour * (1 - share[..., None]) + other * share[..., None]
    return _paint(mixed * (1 + 0.03 * _noise(g, 1.0, 1.0))[..., None], g.uniform(0.18, 0.4))


def _metal(g: np.random.Generator) -> Paint:
    return plain(from_hex(_METALS[g.integers(len(_METALS))]))


def _speckled(
    g: np.random.Generator, colour: Float[np.ndarray, "3"], depth: float, period: float, grain: float
) -> Paint:
    return _paint(colour * (1 + depth * _noise(g, grain, grain))[..., None], period)


def plain(colour: Float[np.ndarray, "3"]) -> Paint:
    """Return a paint of a single colour, sRGB 0..1."""
    return _paint(np.broadcast_to(colour, (4, 4, 3)), 1.0)


def _paint(colours: Float[np.ndarray, "h w 3"], period: float) -> Paint:
    """Make a tile from colours 0..1, clipped away from black and white so that shading stays visible."""
    solid = np.clip(np.concatenate((colours, np.ones((*colours.shape[:2], 1))), -1), 0.06, None)
    solid[..., :3] = np.minimum(solid[..., :3], 0.95)
    return Paint(np.round(np.minimum(solid, 1) * 255).astype(np.uint8), period)


def _noise(g: np.random.Generator, across: float, along: float) -> Float[np.ndarray, "tile tile"]:
    """Make smooth periodic noise: deviation 1, grain ``across`` x ``along`` px."""
    frequency = np.fft.fftfreq(_TILE) * 2 * np.pi
    blur = np.exp(-0.5 * ((frequency[:, None] * along) ** 2 + (frequency * across) ** 2))
    noise = np.fft.ifft2(np.fft.fft2(g.standard_normal((_TILE, _TILE))) * blur).real
    return np.clip((noise - noise.mean()) / noise.std(), -2.5, 2.5)


def any_colour(g: np.random.Generator) -> Float[np.ndarray, "3"]:
    """Sample a household colour: grey, pastel, deep or vivid."""
    kind = g.integers(4)
    saturation = g.uniform((0.0, 0.15, 0.45, 0.65), (0.08, 0.35, 0.8, 0.95))[kind]
    value = g.uniform((0.12, 0.7, 0.2, 0.6), (0.95, 0.95, 0.5, 0.95))[kind]
    return np.array(colorsys.hsv_to_rgb(g.random(), saturation, value))


def _vivid(g: np.random.Generator) -> Float[np.ndarray, "3"]:
    return np.array(colorsys.hsv_to_rgb(g.random(), g.uniform(0.65, 0.95), g.uniform(0.6, 0.95)))


def from_hex(colour: str) -> Float[np.ndarray, "3"]:
    """Return sRGB 0..1 of a hexadecimal colour."""
    return np.frombuffer(bytes.fromhex(colour), np.uint8) / 255.0
