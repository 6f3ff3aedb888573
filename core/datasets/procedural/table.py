"""Renders procedural objects: a sparse table of shapes x textures, so that shape and look vary on their own."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from core.datasets.procedural.cars.car import car
from core.datasets.procedural.cars.paint import car_texture
from core.datasets.procedural.chairs.chair import chair
from core.datasets.procedural.paint import Paint, texture
from core.datasets.procedural.solids import Shape, Solid, surface
from core.datasets.rasteriser import Surface
from core.datasets.render_objects import RenderTask, render_objects
from core.datasets.splits import Split, first_seed

_GENERATORS: dict[str, tuple[Callable[[int], Shape], Callable[[int], Mapping[str, Paint]]]] = {
    "cars": (car, car_texture),
    "chairs": (chair, texture),
}


@dataclass(frozen=True)
class ProceduralObject:
    """One object of the table: a shape's seed and a texture's."""

    category: str
    shape: int
    texture: int

    @property
    def shape_id(self) -> str:
        """What all objects of this shape share."""
        return f"{self.category}-shape-{self.shape:07d}"

    @property
    def texture_id(self) -> str:
        """What all objects of this texture share."""
        return f"{self.category}-texture-{self.texture:07d}"

    @property
    def name(self) -> str:
        """The object's folder."""
        return f"{self.category}-{self.shape:07d}-{self.texture:07d}"


def procedural_table(category: str, count: int, split: Split) -> tuple[ProceduralObject, ...]:
    """``count`` objects from about count / 2 shapes and count / 3 textures.

    Shapes are gone through twice, textures three times; the second round pairs each shape with a texture half the
    table away, so no pair comes twice and shapes and textures form one connected net.
    """
    if category not in _GENERATORS:
        raise ValueError(f"no procedural {category!r}: one of {', '.join(_GENERATORS)}")
    if count < 1:
        raise ValueError(f"count of objects must be positive, got {count}")
    first = first_seed(split)
    shapes, textures = max(1, (count + 1) // 2), max(2, count // 3)
    cells = []
    for i in range(count):
        turn, shape = divmod(i, shapes)
        cells.append(ProceduralObject(category, first + shape, first + (shape + turn * (textures // 2)) % textures))
    return tuple(cells)


def disentanglement_pairs(category: str, count: int, tables: int) -> tuple[ProceduralObject, ...]:
    """Whole tables of four shapes x four textures out of the training table of ``count`` objects, one for each block.

    Half of a table's cells are trained, the other half pairs that never were: each shape and each texture is seen in
    trained cells.
    """
    if tables < 1:
        raise ValueError(f"count of tables must be positive, got {tables}")
    first, textures = first_seed("train"), max(2, count // 3)
    if textures // 4 < tables:
        raise ValueError(f"{tables} tables of four textures are more than {count} objects wear: {textures}")
    cells = []
    for block in range(tables):
        seeds = [first + block * (textures // 4) // tables + turn * (textures // 4) for turn in range(4)]
        cells += [ProceduralObject(category, shape, texture) for shape in seeds for texture in seeds]
    return tuple(cells)


def render_procedural(
    plan: Sequence[ProceduralObject], category: str, out: Path | str, split: Split, views: int, size: int
) -> Iterator[str]:
    """Renders cells into the dataset ``out`` as :func:`core.datasets.render_objects.render_objects` does."""
    tasks = [RenderTask(cell.name, cell.shape_id, cell.texture_id, partial(surfaces, cell)) for cell in plan]
    yield from render_objects(tasks, out, category, split, views, size)


def surfaces(cell: ProceduralObject) -> tuple[Surface, ...]:
    """The object of a cell, ready to draw."""
    make_shape, make_texture = _GENERATORS[cell.category]
    shape, paints = make_shape(cell.shape), make_texture(cell.texture)
    # Labels often share a paint (a chair all of one wood); one surface for each paint means few draw calls.
    painted: dict[int, list[Solid]] = {}
    for part in shape.parts:
        painted.setdefault(id(paints[part.label]), []).append(part.solid)
    distinct = {id(paint): paint for paint in paints.values()}
    return tuple(surface(solids, distinct[key].tile, distinct[key].period) for key, solids in painted.items())
