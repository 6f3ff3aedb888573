"""The light that objects are rendered under: daylight, or for half of the textures a light of their own.

Light belongs to a texture's identity: it changes what the texture code has to say, and never the shape.
"""

import zlib
from dataclasses import dataclass

import numpy as np

Vector = tuple[float, float, float]

_DAYLIGHT_SHARE = 0.5
_GLOSSY_SHARE = 0.4
"""of the lights that are not daylight"""
_LIGHT_STREAM = 77
"""Sets the random numbers of a texture's light apart from others that are seeded with its name."""


@dataclass(frozen=True)
class Light:
    """A key, a fill and a back light, all infinitely far away, and a sky; fixed to the world.

    Powers are in linear light, relative to the surface's colour: where they add up to 1 a surface has its own colour.
    """

    key: Vector
    """world, towards the light; of any length"""
    fill: Vector
    """world, towards the light; of any length"""
    key_power: float
    """on a surface that faces the light"""
    fill_power: float
    back_power: float
    """of a light that comes from behind (-y)"""
    sky: tuple[float, float]
    """power on a surface that faces down, and on one that faces up"""
    gloss: float = 0.0
    """peak of the key light's white highlight (Blinn-Phong), added in linear light; 0: matt"""
    gloss_exponent: float = 20.0
    """the larger, the smaller the highlight"""


DAYLIGHT = Light(
    key=(0.5, 0.65, 1.0), fill=(-0.8, 0.1, 0.35), key_power=0.52, fill_power=0.2, back_power=0.14, sky=(0.26, 0.46)
)
"""From the front right, above; matt, so a point has one colour from wherever it is seen."""


def daylight(texture_id: str) -> Light:
    """The light of a texture where all have the same."""
    return DAYLIGHT


def sample_light(texture_id: str) -> Light:
    """The light of a texture, always the same: daylight for half of the textures, a random plain light for the rest."""
    g = np.random.default_rng([zlib.crc32(texture_id.encode()), _LIGHT_STREAM])
    if g.random() >= 1 - _DAYLIGHT_SHARE:
        return DAYLIGHT
    azimuth = g.uniform(-np.pi, np.pi)
    key = _direction(azimuth, np.radians(g.uniform(15, 85)))
    opposite = azimuth + g.uniform(0.5, 1.5) * np.pi
    fill = _direction(opposite, np.radians(g.uniform(-10, 50)))
    low = g.uniform(0.10, 0.36)
    sky = low, low + g.uniform(0.02, 0.3)
    powers = g.uniform(0.25, 0.85), g.uniform(0.0, 0.35), g.uniform(0.0, 0.2)
    gloss = (g.uniform(0.05, 0.35), g.uniform(12, 50)) if g.random() < _GLOSSY_SHARE else ()
    return Light(key, fill, *powers, sky, *gloss)


def _direction(azimuth: float, elevation: float) -> Vector:
    """A unit vector; rad, z up."""
    flat = np.cos(elevation)
    return float(np.cos(azimuth) * flat), float(np.sin(azimuth) * flat), float(np.sin(elevation))
