"""Objects in an order to choose from: the most different forms first, the variants of a form behind it. Pure."""

import re
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

_SOURCE = re.compile(r"^(blendswap_cc_(0|by)|gazebo|katorlegaz|kenney|quaternius(_realistic|_[a-z]+\d{4})?|scopia)_")
"""who made a mesh, before its name"""
_GENERATED = re.compile(r"^([a-z]+)-(\d{7})(?:-(\d{7}))?$")
"""of the generators: the category, the seed of the form, that of the texture; a family has no texture"""
_VARIANT = re.compile(r"(-form\d+)?(-look\d+)?$")
"""of a mesh: reshaped, repainted"""
_NOUN = re.compile(r"(?<=[a-z])(?<!\barm)(?=(chair|stool)\b)")


def family(name: str) -> str:
    """What the variants of one form have in common.

    >>> family("kenney_chair_desk-form1-look2"), family("chairs-0000087-0000287"), family("object 3")
    ('kenney_chair_desk', 'chairs-0000087', 'object 3')
    """
    if generated := _GENERATED.match(name):
        return f"{generated[1]}-{generated[2]}"
    return _VARIANT.sub("", name)


def readable(name: str) -> str:
    """The name of a training object as a person says it; any other name as it is.

    >>> readable("blendswap_cc_0_antiquechair"), readable("kenney_chair_desk-form1-look2")
    ('Antique chair', 'Chair desk, form 1, look 2')
    >>> readable("chairs-0000087-0000287"), readable("my photo-2")
    ('Chair #87, look 287', 'my photo-2')
    """
    if generated := _GENERATED.match(name):
        form, look = int(generated[2]), int(generated[3] or generated[2])
        return f"{generated[1].removesuffix('s').capitalize()} #{form}" + (f", look {look}" if look != form else "")
    source = _SOURCE.match(name)
    if not source:
        return name
    plain, variant = name[source.end() :], ""
    if found := _VARIANT.search(plain):
        variant = re.sub(r"-([a-z]+)(\d+)", r", \1 \2", found[0])
        plain = plain[: found.start()]
    words = _NOUN.sub(" ", re.sub(r"(?<=[a-z])(\d+)$", r" \1", plain.replace("_", " ")))
    return words[:1].upper() + words[1:] + variant


def farthest_first(points: Float[Tensor, "points size"]) -> list[int]:
    """Indices that begin with the first point; each next one is the farthest from all before it (Gonzalez 1985)."""
    if not len(points):
        return []
    order, left = [0], (points - points[0]).norm(dim=1)
    while len(order) < len(points):
        left[order[-1]] = -1.0  # also where points are equal, each comes once
        order.append(int(left.argmax()))
        left = torch.minimum(left, (points - points[order[-1]]).norm(dim=1))
    return order


def families(names: Sequence[str], codes: Float[Tensor, "names latent"]) -> dict[str, tuple[str, ...]]:
    """The first of each family and its variants, the most different forms first.

    Args:
        codes: shape codes, of which near ones are alike.
    """
    members: dict[str, list[int]] = {}
    for index, name in enumerate(names):
        members.setdefault(family(name), []).append(index)
    groups = list(members.values())
    heads = codes[[group[0] for group in groups]] if groups else codes
    return {names[groups[at][0]]: tuple(names[index] for index in groups[at][1:]) for at in farthest_first(heads)}
