"""What every procedural shape keeps, of whatever category."""

import numpy as np
import pytest

from core.lab.datasets.procedural.solids import Shape


def points(shape: Shape, *labels: str) -> np.ndarray:
    """The vertices of the parts with these labels; without any, of all."""
    return np.concatenate([part.solid.vertices for part in shape.parts if not labels or part.label in labels])


def metres(shape: Shape) -> np.ndarray:
    """Width, length and height, of a shape that is centred and has a diagonal of 1."""
    cloud = points(shape)
    low, high = cloud.min(0), cloud.max(0)
    assert np.isfinite(cloud).all()
    assert np.linalg.norm(high - low) == pytest.approx(1)
    assert low == pytest.approx(-high, abs=1e-9)
    return (high - low) / shape.metre


def faces(shape: Shape) -> int:
    return sum(len(part.solid.faces) for part in shape.parts)
