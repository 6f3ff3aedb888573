"""The kinds of edits, and edits of an object together: their order, their mixture, their JSON, their colours."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from jaxtyping import Float
from torch import Tensor

from core.edits.bend import Bend
from core.edits.edit import Edit, Subject
from core.edits.paint import PartPaint
from core.edits.stretch import Stretch
from core.edits.warp import Warp

KINDS: dict[str, type[Edit]] = {kind.key: kind for kind in (PartPaint, Warp, Bend, Stretch)}
"""All kinds by the key in files. An object has its edits in this order, its size's last."""
_SUBJECTS: tuple[Subject, ...] = "texture", "shape", "size"

Parts = Mapping[str, Float[Tensor, "*places"]]


def ordered(edits: Iterable[Edit]) -> tuple[Edit, ...]:
    """Return edits in the order in which they are made, without those that change nothing.

    Raises ``ValueError`` for too many of one kind.
    """
    order = {key: number for number, key in enumerate(KINDS)}
    effective = [edit for edit in edits if not edit.is_none]
    for kind in {type(edit) for edit in effective}:
        count = sum(type(edit) is kind for edit in effective)
        if count > kind.most:
            raise ValueError(f"an object has at most {kind.most} {kind.key}, got {count}")
    return tuple(sorted(effective, key=lambda edit: (_SUBJECTS.index(edit.subject), order[edit.key])))


def mixed(first: tuple[Edit, ...], second: tuple[Edit, ...], shape: float, texture: float) -> tuple[Edit, ...]:
    """Interpolate between the edits of two objects, kind by kind.

    ``shape`` and ``texture`` are positions from 0 (the first) to 1 (the second).
    """
    mixture = list[Edit]()
    for kind in KINDS.values():
        start, end = (tuple(edit for edit in edits if type(edit) is kind) for edits in (first, second))
        mixture += kind.mixed(start, end, texture if kind.subject == "texture" else shape)
    return tuple(mixture)


def edits_json(edits: Iterable[Edit]) -> dict[str, Any]:
    """Return edits as JSON by their kinds' keys: a value, or a list of a kind that an object has several of."""
    content = dict[str, Any]()
    for edit in edits:
        if edit.most == 1:
            content[edit.key] = edit.to_json()
        else:
            content.setdefault(edit.key, []).append(edit.to_json())
    return content


def read_edits(content: Mapping[str, Any]) -> tuple[Edit, ...]:
    """Read the edits among the entries of :func:`edits_json`. Raises ``ValueError`` for values of other types."""
    edits = list[Edit]()
    for key, kind in KINDS.items():
        value = content.get(key)
        if isinstance(value, list) and kind.most > 1:
            edits += map(kind.from_json, value)
        elif value is not None:
            edits.append(kind.from_json(value))
    return tuple(edits)


def origins(points: Float[Tensor, "*batch 3"], edits: tuple[Edit, ...]) -> Float[Tensor, "*batch 3"]:
    """Return the places that points of an edited object came from, the last edit undone first."""
    for edit in reversed(edits):
        points = edit.origins(points)
    return points


def densities(at_origins: Float[Tensor, "*batch"], edits: tuple[Edit, ...]) -> Float[Tensor, "*batch"]:
    """Return densities at origins as those of the edited object."""
    for edit in edits:
        at_origins = edit.densities(at_origins)
    return at_origins


def colours(
    network: Float[Tensor, "*places 3"], edits: tuple[Edit, ...], parts: Callable[[], Parts]
) -> Float[Tensor, "*places 3"]:
    """Return the network's colours after the edits of a texture, the last one uppermost.

    Args:
        parts: the probabilities of the model's parts, asked for only if there is such an edit.
    """
    painting = [edit for edit in edits if edit.subject == "texture"]
    probabilities = parts() if painting else {}
    below = network
    for edit in painting:
        below = edit.over(network, below, probabilities)
    return below
