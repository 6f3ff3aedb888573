"""Resolutions of the preview; at rest the view gets all its pixels."""

from typing import NamedTuple


class Quality(NamedTuple):
    """Resolution of the preview."""

    detail: int  # px along its shorter side, limited by the view
    samples: int  # intervals along the longest side of the scene's box


QUALITIES = (
    Quality(96, 64),
    Quality(128, 96),
    Quality(192, 128),
    Quality(256, 192),
    Quality(384, 192),
    Quality(512, 192),
    Quality(768, 256),
)  # from coarse to fine; each takes about twice as long as the one before
DEFAULT_QUALITY = 3  # index into :data:`QUALITIES`
