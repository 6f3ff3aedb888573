"""Textures of cars: the paint of each part, independent of the car's shape."""

import colorsys
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from core.lab.datasets.procedural.paint import Paint, from_hex, plain

LABELS = (
    "paint",
    "roof",
    "pillar",
    "band",
    "stripe",
    "roof stripe",
    "sill",
    "arch",
    "bumper",
    "bumper bar",
    "seam",
    "mirror",
    "handle",
    "spoiler",
    "rail",
    "trim",
    "exhaust",
    "chrome",
    "grille",
    "bed",
    "under",
    "glass",
    "light",
    "tail",
    "plate",
    "tyre",
    "wheel",
)  # labels that every texture paints, so that any texture fits any car

Colour = Float[np.ndarray, "3"]

_COMMON = {
    "white": (("f1f1ee", "e9e8e2", "f2efe6"), 0.16),
    "silver": (("b9bcbf", "c8cacb", "a9adb1"), 0.16),
    "grey": (("6d7175", "51555a", "85898c", "4a4e52"), 0.13),
    "black": (("1b1c1f", "212227", "282523"), 0.08),
    "blue": (("1f3f7a", "2b5ea8", "1d3261", "4a7fb5", "7fa3c0"), 0.14),
    "red": (("a3161c", "c4201f", "741519", "8f2a22"), 0.13),
    "earth": (("6b4f38", "a88f6a", "c9b893", "5a4638"), 0.05),
    "green": (("2a5c42", "2f6b4a", "5a6b45", "8fa88a"), 0.05),
}
_VIVID = 0.09  # fraction of cars in a vivid colour of any hue: yellow cabs, orange, lime, turquoise
_WHEELS = ("b4b7ba", "c9cbcc", "8b8f93", "55585c", "222325", "d8d8d4")


def car_texture(seed: int) -> Mapping[str, Paint]:
    """Return the paint of each part label."""
    g = np.random.default_rng([seed, 19])
    main = _body_colour(g)
    dark = plain(from_hex(("1b1c1d", "232425", "2e3032")[g.integers(3)]))
    second = dark if g.random() < 0.4 else plain(_body_colour(g))
    paint = plain(main)
    metal = plain(from_hex(("c4c6c8", "9a9da0")[g.integers(2)]))
    paints = {
        **_colours(g, paint, second, dark),
        "seam": plain(0.4 * main),
        "handle": (paint, metal, dark)[g.choice(3, p=(0.55, 0.25, 0.2))],
        "bumper bar": (metal, dark)[g.choice(2, p=(0.6, 0.4))],
        "rail": (metal, dark)[g.integers(2)],
        "chrome": (metal, dark, paint)[g.choice(3, p=(0.55, 0.3, 0.15))],
        "trim": dark,
        "exhaust": metal,
        "grille": plain(from_hex("18191a")),
    }
    return paints | _constant(g, main)


def _colours(g: np.random.Generator, paint: Paint, second: Paint, dark: Paint) -> dict[str, Paint]:
    """Paint the fields in one colour, or some of them in a second colour or dark plastic."""
    fields = dict.fromkeys(
        ("paint", "roof", "pillar", "band", "stripe", "roof stripe", "sill", "arch", "bumper", "mirror", "spoiler"),
        paint,
    )
    fields["bed"] = dark if g.random() < 0.5 else paint
    style = g.choice(("plain", "roof", "cabin", "lower", "stripe", "band"), p=(0.74, 0.07, 0.04, 0.06, 0.05, 0.04))
    if style in ("roof", "cabin"):
        fields |= {"roof": second, "mirror": second if g.random() < 0.5 else paint}
        fields["roof stripe"] = second
    if style == "cabin":
        fields["pillar"] = second
    if style == "lower":
        fields |= {"sill": second, "bumper": second, "arch": second}
    if style == "stripe":
        fields |= {"stripe": second, "roof stripe": second}
    if style == "band":
        fields["band"] = second
    if g.random() < 0.25:
        fields["pillar"] = dark
    if g.random() < 0.35:
        fields |= {"sill": dark, "bumper": dark, "arch": dark if g.random() < 0.6 else fields["paint"]}
    if g.random() < 0.3:
        fields["mirror"] = dark
    return fields


def _constant(g: np.random.Generator, main: Colour) -> dict[str, Paint]:
    """Return paints that are similar on all cars."""
    # Windows must contrast with the body: light ones with a dark body, dark ones with all others.
    panes = ("5d6e7a", "6f7f88", "7d8c95") if main.max() < 0.3 else ("1d2329", "262d33", "323b42", "14171a")
    glass = from_hex(panes[g.integers(len(panes))])
    tone = np.array([1.0, 1.0, g.uniform(0.85, 1.0)])
    red = np.array([g.uniform(0.55, 0.8), g.uniform(0.06, 0.12), g.uniform(0.06, 0.1)])
    return {
        "glass": plain(glass),
        "light": plain(tone * g.uniform(0.72, 0.95)),
        "tail": plain(red),
        "plate": plain(from_hex(("f0f0ea", "e8c84a", "d9dde6", "e6e4d8")[g.choice(4, p=(0.5, 0.15, 0.2, 0.15))])),
        "under": plain(from_hex("151617")),
        "tyre": plain(from_hex(("1c1c1d", "242425")[g.integers(2)])),
        "wheel": plain(from_hex(_WHEELS[g.choice(6, p=(0.25, 0.2, 0.2, 0.12, 0.13, 0.1))])),
    }


def _body_colour(g: np.random.Generator) -> Colour:
    """Sample a usual car colour with slight variation."""
    if g.random() < _VIVID:
        return np.array(colorsys.hsv_to_rgb(g.random(), g.uniform(0.65, 0.95), g.uniform(0.7, 0.95)))
    shades = list(_COMMON.values())
    weights = np.array([share for _, share in shades])
    tones = shades[g.choice(len(shades), p=weights / weights.sum())][0]
    return np.clip(from_hex(tones[g.integers(len(tones))]) * g.uniform(0.88, 1.12) + g.normal(0, 0.012, 3), 0.06, 0.95)
