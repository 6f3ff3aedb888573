"""What every generator of objects hands over: labelled solids at ShapeNet's scale."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from core.datasets.procedural.solids import Part


@dataclass(frozen=True)
class Shape:
    """An object: bounding box centred on the origin with a diagonal of 1, z up, its front at +y."""

    kind: str
    parts: tuple[Part, ...]
    metre: float
    """scene units"""


def normalised_shape(kind: str, parts: Sequence[Part]) -> Shape:
    """Parts in metres, brought to the shape's place and scale."""
    used = np.concatenate([part.solid.vertices for part in parts])
    low, high = used.min(0), used.max(0)
    metre = 1.0 / float(np.linalg.norm(high - low))
    middle = (low + high) / 2
    placed = [Part(p.label, replace(p.solid, vertices=(p.solid.vertices - middle) * metre)) for p in parts]
    return Shape(kind, tuple(placed), metre)
