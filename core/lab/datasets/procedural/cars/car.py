"""Procedural cars: one car per seed, built of labelled meshes in metres and brought to ShapeNet's scale."""

from dataclasses import replace

import numpy as np

from core.lab.datasets.procedural.cars.bodies import body
from core.lab.datasets.procedural.cars.fittings import fittings
from core.lab.datasets.procedural.cars.kinds import KINDS, sample_dimensions
from core.lab.datasets.procedural.cars.wheels import wheels
from core.lab.datasets.procedural.carving import mirrored
from core.lab.datasets.procedural.solids import Shape, normalised_shape, warped


def car(seed: int) -> Shape:
    """Build the car of a seed, deterministically."""
    generator = np.random.default_rng([seed, 17])
    kind = str(generator.choice(list(KINDS), p=[share for _, share in KINDS.values()]))
    dims = sample_dimensions(generator, kind)
    parts = [replace(p, solid=warped(p.solid, dims.bent)) for p in body(generator, dims) + fittings(generator, dims)]
    parts += wheels(generator, dims)
    return normalised_shape(kind, [replace(part, solid=mirrored(part.solid)) for part in parts])
