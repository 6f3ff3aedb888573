"""Words for the principal directions of a model's codes, such as *taller* or *redder*.

The mean object is moved to both sides along a direction. The differences of its surface and colours decide the word,
each measured in units of the least visible change. No word is used twice; a direction without a visible effect gets
none. To add a word, add a row to :data:`_WORDS` and its measure to :func:`_measured`.
"""

import math
from collections.abc import Iterator, Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from core.models.codes import CodeKind
from core.models.model import Instance, Model, Words
from core.models.motion import moved_along, position, reach
from core.rendering.surface import surface_points

_COUNT = 6  # directions of shape and of texture
_REACH = 1.5  # standard deviations to either side of the mean
_EDGE = 0.01  # fraction of the points at either end of an axis that count as specks outside the object
_CORNER = 0.2  # size of a silhouette's corner relative to its width and height
_LEAST_POINTS = 50  # on a surface worth measuring
_LEAST = 0.5  # units of visibility: smaller changes give no word


_Word = tuple[str, str, float]  # for an increase and for a decrease of a measure, and the least visible change
_WORDS: dict[CodeKind, dict[str, _Word]] = {
    "shape": {
        "width": ("wider", "narrower", 0.05),
        "depth": ("longer", "shorter", 0.05),
        "height": ("taller", "lower", 0.05),
        "roundness": ("rounder", "more angular", 0.06),
        "top": ("heavier top", "heavier base", 0.05),
        "front": ("fuller front", "fuller back", 0.04),
        "upper width": ("wider top", "narrower top", 0.08),
        "upper depth": ("longer top", "shorter top", 0.08),
    },
    "texture": {
        "lightness": ("lighter", "darker", 8.0),
        "red": ("redder", "greener", 7.0),
        "yellow": ("more yellow", "bluer", 7.0),
        "colour": ("more colourful", "greyer", 7.0),
        "top lightness": ("lighter top", "darker top", 8.0),
        "top red": ("redder top", "greener top", 7.0),
        "top yellow": ("more yellow top", "bluer top", 7.0),
        "contrast": ("more contrast", "plainer", 6.0),
    },
}  # by the name of the measure in :func:`_measured`
_SIZES = {word for name in ("width", "depth", "height") for word in _WORDS["shape"][name][:2]}
"""Words of sizes. Objects whose size is set in centimetres have no directions of these names."""
OPPOSITES = {
    word: opposite
    for table in _WORDS.values()
    for more, less, _ in table.values()
    for word, opposite in ((more, less), (less, more))
}  # the opposite of every word


def direction_words(model: Model) -> Iterator[Words | None]:
    """Find words for the first directions of shape and of texture, or read those of the model's file.

    Yields None after each measured direction. The last item has the words of each kind, one per direction, "" if
    unnamed.

    Example:
        >>> from core.models.library import load_model
        >>> *_, words = direction_words(load_model("cars"))
        >>> words["texture"][:2]
        ('lighter', 'plainer')
    """
    if model.words:
        yield _offered(model, model.words)
        return
    words = Words()
    for kind, table in _WORDS.items():
        changes = list[dict[str, float]]()
        steps = getattr(model.codes, f"{kind}_space").basis[:_COUNT]
        for step in steps:
            less, more = (_measured(model.mean.moved(kind, side * _REACH * step)) for side in (-1, 1))
            changes.append({name: more[name] - less[name] for name in more} if less and more else {})
            yield None
        words[kind] = name_changes(changes, table)
    yield _offered(model, words)


def _offered(model: Model, words: Words) -> Words:
    """Return the words of directions that are no sizes; all known words if objects of the model have no size."""
    offered = OPPOSITES.keys() - (_SIZES if model.supports_motion else set())
    return {kind: tuple(word if word in offered else "" for word in words.get(kind, ())) for kind in _WORDS}


def moved(instance: Instance, words: Words, name: str, amount: float) -> Instance:
    """Move an object along a named direction, as far as it may go; the opposite word moves backwards.

    Args:
        words: from :func:`direction_words`.
        amount: standard deviations.

    Raises ``ValueError`` for an unknown name.
    """
    kind, number, sign = _direction(words, name)
    if kind == "texture":
        return instance.moved(kind, sign * amount * instance.model.codes.texture_space.basis[number])
    return moved_along(instance, number, position(instance, number) + sign * amount)


def most(instance: Instance, words: Words, name: str) -> float:
    """Return the largest amount by which :func:`moved` moves an object along a named direction, standard deviations.

    Raises ``ValueError`` for an unknown name.
    """
    kind, number, sign = _direction(words, name)
    if kind == "texture":
        return math.inf
    low, high = reach(instance, number)
    strength = position(instance, number)
    return high - strength if sign > 0 else strength - low


def _direction(words: Words, name: str) -> tuple[CodeKind, int, int]:
    """Return kind and number of a named direction, and 1, or -1 for its opposite."""
    directions = dict[str, tuple[CodeKind, int, int]]()
    for kind in _WORDS:
        for number, word in enumerate(words[kind]):
            if word:
                directions |= {word: (kind, number, 1), OPPOSITES[word]: (kind, number, -1)}
    if name in _SIZES - directions.keys():
        raise ValueError(f"{name} is a size: set it in centimetres (--size-cm)")
    if name not in directions:
        raise ValueError(f"no direction {name!r}; choose one of {', '.join(directions)}")
    return directions[name]


def name_changes(changes: list[dict[str, float]], table: Mapping[str, _Word]) -> tuple[str, ...]:
    """Return a word for each direction's changes of measures, "" if none is clear; the clearest change chooses first.

    Example:
        >>> table = {"height": ("taller", "lower", 0.1), "width": ("wider", "narrower", 0.1)}
        >>> name_changes([{"height": -0.3, "width": 0.2}, {"height": 0.4}, {"height": 0.02}], table)
        ('wider', 'taller', '')
    """
    clear = [
        (abs(change[name]) / unit, number, name)
        for number, change in enumerate(changes)
        for name, (_, _, unit) in table.items()
        if name in change
    ]
    words = [""] * len(changes)
    taken = set[str]()
    for size, number, name in sorted(clear, reverse=True):
        if size >= _LEAST and not words[number] and name not in taken:
            more, less, _ = table[name]
            words[number] = more if changes[number][name] > 0 else less
            taken.add(name)
    return tuple(words)


def _measured(instance: Instance) -> dict[str, float]:
    """Return the measures of an object by name; empty if it has nearly no surface.

    Sizes are logarithms of standard deviations, which are finer than extents for points on a grid.
    """
    points, colours = (values.cpu() for values in surface_points(instance))
    if len(points) < _LEAST_POINTS:
        return {}
    low, high = points.quantile(torch.tensor([_EDGE, 1 - _EDGE]), dim=0)
    unit_points = ((points - low) / (high - low).clamp_min(1e-6)).clamp(0, 1)  # in the surface's box
    upper = points[unit_points[:, 2] > 0.5]
    width, depth, height = _log_sizes(points)
    upper_width, upper_depth, _ = _log_sizes(upper if len(upper) > 2 else points)
    lab = _lab(colours)
    lightness, red, yellow = lab.mean(0).tolist()
    above = points[:, 2] > (points[:, 2].min() + points[:, 2].max()) / 2
    top = lab[above].mean(0) - lab[~above].mean(0) if 0 < int(above.sum()) < len(above) else torch.zeros(3)
    return {
        "width": width,
        "depth": depth,
        "height": height,
        "roundness": _roundness(unit_points),
        "top": float(unit_points[:, 2].mean()),
        "front": float(unit_points[:, 1].mean()),
        "upper width": upper_width - width,
        "upper depth": upper_depth - depth,
        "lightness": lightness,
        "red": red,
        "yellow": yellow,
        "colour": math.hypot(red, yellow),
        **dict(zip(("top lightness", "top red", "top yellow"), top.tolist(), strict=True)),
        "contrast": float(lab[:, 0].std()),
    }


def _log_sizes(points: Float[Tensor, "points 3"]) -> list[float]:
    return points.std(0).clamp_min(1e-6).log().tolist()


def _roundness(unit_points: Float[Tensor, "points 3"]) -> float:
    """Return the empty fraction of the corners of three silhouettes, 0..1."""
    cells = 20
    corner = round(cells * _CORNER)
    ends = (slice(0, corner), slice(cells - corner, cells))
    empty = []
    for axes in ((0, 2), (1, 2), (0, 1)):
        filled = torch.zeros(cells, cells, dtype=torch.bool)
        filled[tuple((unit_points[:, axes] * cells).long().clamp(0, cells - 1).T)] = True
        empty.append(1 - sum(float(filled[x, y].float().mean()) for x in ends for y in ends) / 4)
    return sum(empty) / len(empty)


def _lab(colours: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
    """Convert sRGB colours (0..1) to CIE L*a*b* under D65."""
    linear = torch.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055).clamp_min(0) ** 2.4)
    to_xyz = torch.tensor([[0.4339, 0.3762, 0.1899], [0.2126, 0.7152, 0.0722], [0.0178, 0.1095, 0.8727]])
    xyz = linear @ to_xyz.T  # ones for white
    x, y, z = torch.where(xyz > 0.008856, xyz.clamp_min(1e-6) ** (1 / 3), 7.787 * xyz + 16 / 116).unbind(-1)
    return torch.stack((116 * y - 16, 500 * (x - y), 200 * (y - z)), -1)
