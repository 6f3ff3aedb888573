"""Descriptions of how much of an object comes from its photos."""

import math
from collections.abc import Mapping

from core.geometry.camera import Camera
from core.models.model import Model
from core.rendering.progressive import Frame
from viewer.values import orbit

SIDES = {
    "front": orbit.VIEWS["front"],
    "right side": orbit.VIEWS["side"],
    "back": (orbit.FRONT_AZIMUTH + math.pi, 0.0),
    "left side": (orbit.FRONT_AZIMUTH + math.pi / 2, 0.0),
}  # azimuth and elevation of the camera facing each side
_SIZE = 32  # px of the renders examined
_COVERED = 0.4  # fraction of a side's pixels from which it counts as from a photo


def side_cameras(model: Model) -> dict[str, Camera]:
    """Return a small view of every side."""
    return {name: model.camera(*angles).resized(_SIZE, _SIZE) for name, angles in SIDES.items()}


def describe_sources(model: Model, frames: Mapping[str, Frame]) -> str:
    """List the sides from the photo and from its mirror image, given frames of the sides."""
    found: dict[str, list[str]] = {"photo": [], "mirrored": []}
    for side, frame in frames.items():
        if frame.sources is not None:
            shares = frame.sources.sum((0, 1)) / max(1e-6, float(frame.opacity.sum()))
            kind = max(zip(shares, found, strict=True))[1]
            if shares.sum() >= _COVERED:
                found[kind].append(side)
    photo, mirrored = (_listed(sides) for sides in found.values())
    parts = [f"{photo} from the photo" if photo else "", f"{mirrored} from its mirror image" if mirrored else ""]
    said = ", ".join(filter(None, parts)) or "little from the photo"
    left = len(frames) - sum(map(len, found.values()))
    return said[0].upper() + said[1:] + (f", the rest from other {model.noun}s" if left else "")


def _listed(sides: list[str]) -> str:
    return " and ".join(filter(None, (", ".join(sides[:-1]), *sides[-1:])))
