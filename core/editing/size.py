"""The size of an object in centimetres, and the stretch of space that gives it another one.

A photo shows no scale, and all objects of a model have one size. So the natural size of an object is that of its
surface's bounds, the longest side being as long as a typical one of the category (:attr:`Model.metres`). Another size
stretches space along the axes (:mod:`core.edits.stretch`), which cannot break an object. Longer legs or a higher roof
stretch it below or above a plane only: a bend (:mod:`core.edits.bend`) with a stretch.
"""

from core.editing.bounds import Bounds, Size, bounds_of, natural_bounds, portion_of
from core.edits.bend import MAX_BEND, Bend
from core.edits.stretch import LEAST, MAX_DISTORTION, MOST, Stretch
from core.models.model import Instance

SIDES = "width", "depth", "height"
LIMITS = 0.1, 100_000.0  # cm, of a length
_DIGITS = 9  # of a factor, so that a length as before leaves no edit
_TOLERANCE = 1e-4  # relative difference of a length from the wanted one, above which it is out of reach


def size_of(instance: Instance) -> Size:
    """Return the size of an object. Raises ``ValueError`` if it has no surface, and for M1 and M2."""
    return bounds_of(instance).size


def sized(instance: Instance, size: tuple[float, ...] | None) -> Instance:
    """Return an object stretched to a size; None: in its natural size and proportions.

    Args:
        size: width, depth and height in cm.

    Raises ``ValueError`` for a size that is no length or too far from the natural one, for an object without a surface,
    and for models that paint the background.

    Example:
        >>> import core
        >>> chair = core.sized(core.load_model("chairs")[3], (60.0, 58.0, 92.0))
        >>> [round(side, 6) for side in size_of(chair)]
        [60.0, 58.0, 92.0]
    """
    if size is None:
        return instance.natural
    if len(size) != 3 or not all(LIMITS[0] <= side <= LIMITS[1] for side in size):  # false for NaN
        raise ValueError(f"a size is three lengths from {LIMITS[0]:g} to {LIMITS[1]:g} cm, got {described(size)}")
    natural = _measured(instance)
    unstretched = natural.after(instance.codes.with_edits(Stretch).edits_of("size")).size
    x, y, z = (side / before for side, before in zip(size, unstretched, strict=True))
    factors = sorted((x, y, z))
    if factors[0] < LEAST or factors[-1] > MOST or factors[-1] > MAX_DISTORTION * factors[0]:
        raise ValueError(
            f"{described(size)} is too far from the natural {described(natural.size)}: sides differ by a factor of "
            f"{MOST:g} at most, and not one by {MAX_DISTORTION:g} times as much as another"
        )
    return instance.with_edits(Stretch, Stretch((x, y, z)))


def _measured(instance: Instance) -> Bounds:
    if instance.model.white_from_network:
        raise ValueError("objects of a model that paints the background have no size")
    return natural_bounds(instance)


def lengths(instance: Instance, natural: Bounds) -> dict[str, float]:
    """Return the lengths of an object in cm that can be changed: its sides, and legs or roof, if it has any.

    Args:
        natural: its natural bounds.
    """
    bounds = natural.after(instance.codes.edits_of("size"))
    portion = portion_of(instance.model)
    portions = {portion.name: bounds.length(portion)} if portion and bounds.plane is not None else {}
    return dict(zip(SIDES, bounds.size, strict=True)) | portions


def resized(instance: Instance, natural: Bounds, name: str, length: float) -> Instance:
    """Return an object with another length, one of :func:`lengths`, as near as limits allow."""
    if name not in SIDES:
        return with_portion(instance, natural, length)
    axis = SIDES.index(name)
    factor = instance.codes.factors[axis] * length / lengths(instance, natural)[name]
    return with_side(instance, axis, round(factor, _DIGITS))


def shown_bounds(instance: Instance, natural: Bounds) -> Bounds:
    """Return the bounds of an object as cameras see it: images show no scale."""
    return natural.after(instance.codes.edits_of("size")).in_units(instance.codes.scale)


def with_side(instance: Instance, axis: int, factor: float) -> Instance:
    """Return an object stretched by another factor along an axis, as near to that as limits allow."""
    return instance.with_edits(Stretch, Stretch(instance.codes.factors).with_side(axis, factor))


def portion_sized(instance: Instance, name: str, length: float, keeps_height: bool = False) -> Instance:
    """Return an object with legs (chairs) or a roof (cars) of a length in cm.

    Legs end at the underside of the seat, a roof begins at the lower edge of the windows.

    Args:
        keeps_height: of the object; False: the rest of it keeps its height.

    Raises ``ValueError`` for an object without such a portion, and for a length that is out of reach.

    Example:
        >>> import core
        >>> chair = core.sized(core.load_model("chairs")[3], (60.0, 58.0, 92.0))
        >>> chair = core.portion_sized(chair, "legs", 45.0, keeps_height=True)
        >>> [round(side, 6) for side in size_of(chair)]
        [60.0, 58.0, 92.0]
    """
    portion = portion_of(instance.model)
    natural = _measured(instance)
    if portion is None or portion.name != name or natural.plane is None:
        noun = instance.model.noun or "object"
        reach = f"only its {portion.name}" if portion and natural.plane is not None else "only the whole of it"
        raise ValueError(f"the {name} of this {noun} cannot be sized, {reach}")
    if not LIMITS[0] <= length <= LIMITS[1]:
        raise ValueError(f"a length is {LIMITS[0]:g} to {LIMITS[1]:g} cm, got {length:g}")
    changed = with_portion(instance, natural, length, keeps_height)
    nearest = bounds_of(changed).length(portion)
    if abs(nearest - length) > _TOLERANCE * length:
        raise ValueError(f"{name} of {length:.4g} cm are out of reach of this object, the nearest are {nearest:.3g} cm")
    return changed


def with_portion(instance: Instance, natural: Bounds, length: float, keeps_height: bool = False) -> Instance:
    """Return :func:`portion_sized` for a length as near as limits allow, of an object with a plane.

    Args:
        natural: its natural bounds.
    """
    portion = portion_of(instance.model)
    assert portion is not None and natural.plane is not None
    bounds = natural.after(instance.codes.edits_of("size"))
    rest = bounds.size[2] - bounds.length(portion)
    usual = natural.length(portion) / natural.size[2]
    least = max(usual / MAX_BEND, 1 - (1 - usual) * MAX_BEND)
    most = min(usual * MAX_BEND, 1 - (1 - usual) / MAX_BEND)
    fraction = max(least, min(most, length / (bounds.size[2] if keeps_height else rest + length)))
    height = bounds.size[2] if keeps_height else rest / (1 - fraction)
    low = natural.low[2]
    high = natural.high[2]
    moved = low + (high - low) * (fraction if portion.is_below else 1 - fraction)
    bent = instance.with_edits(Bend, Bend(low, natural.plane, moved, high))
    return with_side(bent, 2, height / natural.size[2])


def described(size: tuple[float, ...]) -> str:
    """Return a size in words.

    Example:
        >>> described((60.0, 58.24, 92.0))
        '60 x 58.2 x 92 cm'
    """
    return " x ".join(f"{side:.6g}" if abs(side) >= 1000 else f"{side:.3g}" for side in size) + " cm"
