"""Procedural objects: a sparse table of shapes x textures, so that both vary independently."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from core.lab.datasets.categories import Split
from core.lab.datasets.procedural.cars.car import car
from core.lab.datasets.procedural.cars.paint import car_texture
from core.lab.datasets.procedural.chairs.chair import chair
from core.lab.datasets.procedural.paint import Paint, texture
from core.lab.datasets.procedural.solids import Shape, Solid, surface
from core.lab.datasets.rasteriser import Surface
from core.lab.datasets.render_objects import RenderTask
from core.lab.datasets.splits import first_seed

_GENERATORS: dict[str, tuple[Callable[[int], Shape], Callable[[int], Mapping[str, Paint]]]] = {
    "cars": (car, car_texture),
    "chairs": (chair, texture),
}


@dataclass(frozen=True)
class ProceduralObject:
    """An object of the table: the seeds of its shape and its texture."""

    category: str
    shape: int
    texture: int

    @property
    def shape_id(self) -> str:
        """Name shared by all objects of this shape."""
        return f"{self.category}-shape-{self.shape:07d}"

    @property
    def texture_id(self) -> str:
        """Name shared by all objects of this texture."""
        return f"{self.category}-texture-{self.texture:07d}"

    @classmethod
    def named(cls, name: str) -> "ProceduralObject | None":
        """Parse the name of an object's folder; None for other names."""
        category, *seeds = name.split("-")
        if category not in _GENERATORS or len(seeds) != 2 or not all(seed.isdecimal() for seed in seeds):
            return None
        return cls(category, *map(int, seeds))

    @property
    def name(self) -> str:
        """Name of the object's folder."""
        return f"{self.category}-{self.shape:07d}-{self.texture:07d}"


def procedural_table(category: str, count: int, split: Split) -> tuple[ProceduralObject, ...]:
    """Return ``count`` objects from about count / 2 shapes and count / 3 textures.

    Each shape is used twice, each texture three times. The second round pairs each shape with a texture half the table
    away, so that no pair repeats and shapes and textures form one connected graph. Raises ``ValueError`` for an unknown
    category or a count below 1.
    """
    if category not in _GENERATORS:
        raise ValueError(f"no procedural {category!r}: one of {', '.join(_GENERATORS)}")
    if count < 1:
        raise ValueError(f"count of objects must be positive, got {count}")
    first = first_seed(split)
    shapes, textures = max(1, (count + 1) // 2), max(2, count // 3)
    objects = []
    for i in range(count):
        turn, shape = divmod(i, shapes)
        texture = (shape + turn * (textures // 2)) % textures
        objects.append(ProceduralObject(category, first + shape, first + texture))
    return tuple(objects)


def disentanglement_pairs(category: str, count: int, tables: int) -> tuple[ProceduralObject, ...]:
    """Return full tables of four shapes x four textures of the ``count`` training objects.

    Half of a table's pairs are trained, and each shape and each texture occurs in a trained pair. Raises ``ValueError``
    for too few textures.
    """
    if tables < 1:
        raise ValueError(f"count of tables must be positive, got {tables}")
    first, textures = first_seed("train"), max(2, count // 3)
    if textures // 4 < tables:
        raise ValueError(f"{tables} tables of four textures are more than {count} objects have: {textures}")
    objects = []
    for table in range(tables):
        seeds = [first + table * (textures // 4) // tables + turn * (textures // 4) for turn in range(4)]
        objects += [ProceduralObject(category, shape, texture) for shape in seeds for texture in seeds]
    return tuple(objects)


def procedural_tasks(objects: Sequence[ProceduralObject]) -> tuple[RenderTask, ...]:
    """Return render tasks of the objects."""
    return tuple(RenderTask(one.name, one.shape_id, one.texture_id, partial(surfaces, one)) for one in objects)


def shape_of(category: str, seed: int) -> Shape:
    """Return the shape of a seed, with its labelled parts."""
    return _GENERATORS[category][0](seed)


def surfaces(item: ProceduralObject) -> tuple[Surface, ...]:
    """Return an object's surfaces, ready to render."""
    shape, paints = shape_of(item.category, item.shape), _GENERATORS[item.category][1](item.texture)
    # Labels often share a paint (an all-wood chair): one surface for each paint means few draw calls.
    painted: dict[int, list[Solid]] = {}
    for part in shape.parts:
        painted.setdefault(id(paints[part.label]), []).append(part.solid)
    distinct = {id(paint): paint for paint in paints.values()}
    return tuple(surface(solids, distinct[key].tile, distinct[key].period) for key, solids in painted.items())
