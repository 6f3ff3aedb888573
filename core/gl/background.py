"""Image backgrounds: a colour, or a vertical gradient."""

import numpy as np
from jaxtyping import Float

Rgb = tuple[int, int, int]  # 0..255
Gradient = tuple[Rgb, Rgb]  # at the upper and the lower edge
Background = Rgb | Gradient
_BEGINS = 0.25  # fraction of the height above which a gradient stays at its upper colour
GLSL = f"""
uniform vec3 top, bottom;
vec3 background(float down) {{ return mix(top, bottom, smoothstep({_BEGINS}, 1.0, down)); }}
"""  # `background(down)`: the colour at a height, 0 at the upper edge and 1 at the lower


def edges(background: Background) -> Gradient:
    """Return a background as a gradient: the colours at the upper and the lower edge."""
    return background if isinstance(background[0], tuple) else (background, background)


def background_rows(background: Background, height: int) -> Float[np.ndarray, "height 1 3"]:
    """Return the colour (0..255) of each row of an image."""
    top, bottom = (np.array(colour, float) for colour in edges(background))
    progress = (((np.arange(height) + 0.5) / height - _BEGINS) / (1 - _BEGINS)).clip(0, 1)[:, None, None]
    return top + progress**2 * (3 - 2 * progress) * (bottom - top)
