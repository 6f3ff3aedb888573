"""Readable names of training objects, and their order: the most different forms first, each with its variants."""

import re
from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor

from core.models.codes import farthest_first

_SOURCE = re.compile(
    r"^(aws|blendswap_cc_(0|by)|chrono|cm|gazebo|infinigen|jme|jtoastie|kaolin|katorlegaz|kaykit(_furniture|_restaurant)?"
    r"|kenney|khronos|morse|polygoogle|polyhaven|quaternius(_realistic|_house|_zombie|_[a-z]+\d{4})?|scopia|servicesim"
    r"|sh_scopia|sharetextures|sk|smarts|zhabotinsky)_"
)  # prefix of a mesh's name: its source
_GENERATED = re.compile(r"^([a-z]+)-(\d{7})(?:-(\d{7}))?$")  # category, seed of the form, seed of the texture
_VARIANT = re.compile(r"(-form\d+)?(-look\d+)?$")  # suffix of a deformed or recoloured mesh
_NUMBERED = re.compile(r" \(\d+\)$")  # suffix of a name that was taken
_NOUN = re.compile(r"(?<=[a-z])(?<!\barm)(?=(chair|stool)\b)")


def family(name: str) -> str:
    """Return the common name of the variants of one form.

    >>> family("kenney_chair_desk-form1-look2"), family("chairs-0000087-0000287"), family("object 3")
    ('kenney_chair_desk', 'chairs-0000087', 'object 3')
    """
    if generated := _GENERATED.match(name):
        return f"{generated[1]}-{generated[2]}"
    return _VARIANT.sub("", name)


def readable(name: str) -> str:
    """Return a readable name for a training object, and any other name as it was given.

    >>> readable("blendswap_cc_0_antiquechair"), readable("kenney_chair_desk-form1-look2")
    ('Antique chair', 'Chair desk, form 1, look 2')
    >>> readable("infinigen_chair_0103-form2"), readable("kaykit_restaurant_chair_stool"), readable("jme_ford_ranger")
    ('Chair 103, form 2', 'Chair stool', 'Ford ranger')
    >>> readable("polyhaven_bar_chair_round_01"), readable("zhabotinsky_hatchback_kiri10-look2")
    ('Bar chair round 01', 'Hatchback kiri 10, look 2')
    >>> readable("chairs-0000087-0000287"), readable("my photo-2 (3)")
    ('Chair 87, another look', 'my photo-2')
    """
    if generated := _GENERATED.match(name):
        look = "" if generated[3] in (None, generated[2]) else ", another look"
        return f"{generated[1].removesuffix('s').capitalize()} {int(generated[2])}{look}"
    source = _SOURCE.match(name)
    if not source:
        return _NUMBERED.sub("", name)
    plain = name[source.end() :]
    variant = ""
    if suffix := _VARIANT.search(plain):
        variant = re.sub(r"-([a-z]+)(\d+)", r", \1 \2", suffix[0])
        plain = plain[: suffix.start()]
    plain = re.sub(r"_(\d{3,})$", lambda number: f" {int(number[1])}", plain)
    words = _NOUN.sub(" ", re.sub(r"(?<=[a-z])(\d+)$", r" \1", plain.replace("_", " ")))
    return words[:1].upper() + words[1:] + variant


def families(names: Sequence[str], codes: Float[Tensor, "names latent"]) -> dict[str, tuple[str, ...]]:
    """Return each form's first object and its variants, the forms with the most different shape codes first."""
    members: dict[str, list[int]] = {}
    for index, name in enumerate(names):
        members.setdefault(family(name), []).append(index)
    groups = list(members.values())
    heads = codes[[group[0] for group in groups]] if groups else codes
    ordered = (groups[index] for index in farthest_first(heads))
    return {names[head]: tuple(names[index] for index in variants) for head, *variants in ordered}
