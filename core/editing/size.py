"""The size of an object in centimetres, and the stretch of space that gives it another one.

A photo shows no scale, and all objects of a model have one size. So the natural size of an object is that of its
surface's bounds, the longest side being as long as a typical one of the category (:attr:`Model.metres`). Another size
stretches space along the axes (:mod:`core.edits.stretch`), which cannot break an object. Longer legs or a higher roof
stretch it below or above a plane only: a bend (:mod:`core.edits.bend`) with a stretch.
"""

from core.editing.bounds import Bounds, Size, bounds_of, natural_bounds, portion_of
from core.edits.bend import MAX_BEND, Bend
from core.edits.stretch import Stretch
from core.models.model import Instance
from core.runtime.modes import isolated

SIDES = "width", "depth", "height"
LIMITS = 0.1, 100_000.0  # cm, of a length
_DIGITS = 9  # of a factor, so that a length as before leaves no edit
_TOLERANCE = 1e-4  # relative difference of a length from the wanted one, above which it is out of reach


def size_of(instance: Instance) -> Size:
    """Return the size of an object. Raises ``ValueError`` if it has no surface, and for M1 and M2."""
    return bounds_of(instance).size


@isolated
def sized(instance: Instance, **cm: float) -> Instance:
    """Return an object of other lengths; without any, in its natural size and proportions.

    Legs end at the underside of the seat, a roof begins at the lower edge of the windows.

    Args:
        cm: width, depth, height, and legs (chairs) or roof (cars), which change the height unless that is given.

    Raises ``ValueError`` for a length that the object has not or cannot have, for an object without a surface, and for
    models that paint the background.

    Example:
        >>> import core
        >>> chair = core.sized(core.load_model("chairs")[3], width=60.0, depth=58.0, height=92.0, legs=45.0)
        >>> {name: round(length, 6) for name, length in lengths(chair, natural_bounds(chair)).items()}
        {'width': 60.0, 'depth': 58.0, 'height': 92.0, 'legs': 45.0}
    """
    if not cm:
        return instance.natural
    if instance.model.white_from_network:
        raise ValueError("objects of a model that paints the background have no size")
    natural = natural_bounds(instance)
    natural_lengths = lengths(instance, natural)
    for name, length in cm.items():
        if name not in natural_lengths:
            raise ValueError(f"this object has no {name} to be sized, only {', '.join(natural_lengths)}")
        if not LIMITS[0] <= length <= LIMITS[1]:  # also for NaN
            raise ValueError(f"a length is {LIMITS[0]:g} to {LIMITS[1]:g} cm, got {length:g}")
    unstretched = natural.after(instance.codes.with_edits(Stretch).edits_of("size")).size
    x, y, z = (cm.get(name, natural_lengths[name]) / side for name, side in zip(SIDES, unstretched, strict=True))
    try:
        changed = instance.with_edits(Stretch, Stretch((x, y, z)))
    except ValueError as error:
        raise ValueError(
            f"{' x '.join(f'{side:.4g}' for side in natural.size)} cm is the natural size: {error}"
        ) from None
    for name in cm.keys() - {*SIDES}:
        changed = with_portion(changed, natural, cm[name], keeps_height="height" in cm)
    for name, length in cm.items():
        nearest = lengths(changed, natural)[name]
        if abs(nearest - length) > _TOLERANCE * length:
            raise ValueError(f"{name} cannot become {length:.4g} cm long, the nearest is {nearest:.3g} cm")
    return changed


def lengths(instance: Instance, natural: Bounds) -> dict[str, float]:
    """Return the lengths of an object in cm that can be changed: its sides, and legs or roof, if it has any."""
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


def with_portion(instance: Instance, natural: Bounds, length: float, keeps_height: bool = False) -> Instance:
    """Return an object with legs or a roof of a length in cm, as near as limits allow.

    Its natural bounds have a plane. With ``keeps_height`` the whole object keeps its height, else the rest of it.
    """
    portion = portion_of(instance.model)
    assert portion is not None and natural.plane is not None
    bounds = natural.after(instance.codes.edits_of("size"))
    rest = bounds.size[2] - bounds.length(portion)
    usual = natural.length(portion) / natural.size[2]
    shortest = max(usual / MAX_BEND, 1 - (1 - usual) * MAX_BEND)
    longest = min(usual * MAX_BEND, 1 - (1 - usual) / MAX_BEND)
    fraction = max(shortest, min(longest, length / (bounds.size[2] if keeps_height else rest + length)))
    height = bounds.size[2] if keeps_height else rest / (1 - fraction)
    low = natural.low[2]
    high = natural.high[2]
    moved = low + (high - low) * (fraction if portion.is_below else 1 - fraction)
    bent = instance.with_edits(Bend, Bend(low, natural.plane, moved, high))
    return with_side(bent, 2, height / natural.size[2])
