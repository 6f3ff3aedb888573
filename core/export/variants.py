"""Versions of an object that differ in colours alone, for one file: by name, in the order in which it lists them."""

from collections.abc import Mapping

from core.models.model import Instance


def is_variant(first: Instance, second: Instance) -> bool:
    """Return whether two objects differ in colours alone."""
    same_model = first.fingerprint == second.fingerprint
    return same_model and first.codes.form_key == second.codes.form_key


def require_one_shape(variants: Mapping[str, Instance]) -> None:
    """Raise ``ValueError`` naming the first variant whose shape or size is not that of the one before all others."""
    first, *further = variants
    for name in further:
        if not is_variant(variants[first], variants[name]):
            raise ValueError(f"{name} has another shape than {first}: a file holds versions of one shape")
