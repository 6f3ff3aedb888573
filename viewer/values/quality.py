"""How fine the image is that is rendered at once; once the hand rests it gets all pixels of the view."""

from typing import NamedTuple


class Quality(NamedTuple):
    """Of the image that is rendered at once."""

    detail: int  # px along its shorter side, if the view has as many
    samples: int  # intervals along the longest side of the scene's box


QUALITIES = (
    Quality(96, 64),
    Quality(128, 96),
    Quality(192, 128),
    Quality(256, 192),
    Quality(384, 192),
    Quality(512, 192),
    Quality(768, 256),
)  # From coarse to fine; each takes about twice as long as the one before.
DEFAULT_QUALITY = 3  # index into :data:`QUALITIES`
