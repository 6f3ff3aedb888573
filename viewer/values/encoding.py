"""Frozen values as JSON, by the types of their fields; tensors, timelines and photos stand beside it, each once."""

import io
import types
from collections.abc import Callable
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
import torch
from jaxtyping import AbstractArray
from PIL import Image
from torch import Tensor

from core.export.keyframes import Timeline
from core.geometry.pixels import to_bytes
from core.photos.photo import Photo
from viewer.values.fit_history import FittedPhoto


@dataclass(eq=False)
class Parts:
    """What JSON refers to by number: many states share a code or a timeline, and numbers in bulk are no text."""

    tensors: list[Tensor] = field(default_factory=list)
    photos: list[bytes] = field(default_factory=list)
    """PNG files, the mask as opacity"""
    timelines: list[Any] = field(default_factory=list)
    """as JSON"""
    _known: dict[int, tuple[object, int]] = field(default_factory=dict)
    """by their identity, the values that are in already, kept alive, and their numbers"""

    def number(self, value: object, stored: list, make: Callable[[], Any]) -> int:
        """Of a value in a list, which it joins unless it is there."""
        if id(value) not in self._known:
            made = make()
            self._known[id(value)] = value, len(stored)
            stored.append(made)
        return self._known[id(value)][1]


def encode(value: Any, parts: Parts) -> Any:
    """A value as JSON; what it refers to joins the parts."""
    if isinstance(value, Tensor):
        return parts.number(value, parts.tensors, lambda: value.detach().cpu().contiguous())
    if isinstance(value, Timeline):
        return parts.number(value, parts.timelines, lambda: _encode_fields(value, parts))
    if isinstance(value, Photo):
        image = parts.number(value, parts.photos, lambda: encode_photo(value))
        return {"image": image} | {name: encode(getattr(value, name), parts) for name in _BESIDE_IMAGE}
    if isinstance(value, FittedPhoto):
        return {"source": encode(value.source, parts), "photo": encode(value.photo, parts)}
    if is_dataclass(value) or hasattr(value, "_fields"):
        return _encode_fields(value, parts)
    if isinstance(value, tuple):
        return [encode(one, parts) for one in value]
    return str(value) if isinstance(value, Path) else value


def decode(kind: Any, value: Any, parts: Parts) -> Any:
    """What :func:`encode` was given, of a type; fields that are not there have their defaults.

    Raises ``ValueError``, ``TypeError``, ``KeyError`` or ``IndexError`` where it is no such value.
    """
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        (only,) = (one for one in arguments if one is not types.NoneType)
        return None if value is None else decode(only, value, parts)
    if origin is Literal:
        return arguments[arguments.index(value)]
    if origin is tuple:
        every = arguments[:1] * len(value) if arguments[-1] is ... else arguments
        return tuple(decode(one, part, parts) for one, part in zip(every, value, strict=True))
    if kind in _SPECIAL:
        return _SPECIAL[kind](value, parts)
    if issubclass(kind, AbstractArray):
        return _checked(parts.tensors[value], kind)
    if is_dataclass(kind) or hasattr(kind, "_fields"):
        return _decode_fields(kind, value, parts)
    if kind is Path:
        return Path(value)
    return _checked(float(value) if kind is float and type(value) is int else value, kind)


def encode_photo(photo: Photo) -> bytes:
    """A photo as a PNG, its mask as opacity."""
    pixels = to_bytes(photo.pixels)
    file = io.BytesIO()
    Image.fromarray(np.dstack((pixels, 255 * photo.mask.numpy().astype(np.uint8)))).save(file, "PNG")
    return file.getvalue()


def decode_photo(file: bytes, **beside: Any) -> Photo:
    """What :func:`encode_photo` was given, and its other fields. Raises ``ValueError`` where it is no photo."""
    try:
        with Image.open(io.BytesIO(file)) as image:
            rgba = torch.from_numpy(np.array(image.convert("RGBA")))
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"no image: {error}") from None
    return Photo(rgba[..., :3].float() / 255, rgba[..., 3] > 127, **beside)


_BESIDE_IMAGE = "camera", "cropped", "scaled", "unseen", "opacity", "edge_error", "focal", "blur"
"""Fields of a photo that a PNG cannot hold."""


def _decode_photo(about: dict, parts: Parts) -> Photo:
    kinds = _kinds(Photo)
    beside = {name: decode(kinds[name], about[name], parts) for name in _BESIDE_IMAGE if name in about}
    return decode_photo(parts.photos[about["image"]], **beside)


def _decode_fitted_photo(about: dict, parts: Parts) -> FittedPhoto:
    source = decode(_kinds(FittedPhoto)["source"], about["source"], parts)
    return FittedPhoto.of(source, _decode_photo(about["photo"], parts))


def _decode_timeline(number: int, parts: Parts) -> Timeline:
    """The same one for the same number, once it has been decoded."""
    found = parts.timelines[number]
    if not isinstance(found, Timeline):
        found = parts.timelines[number] = _decode_fields(Timeline, found, parts)
    return found


_SPECIAL: dict[Any, Callable[[Any, Parts], Any]] = {
    Photo: _decode_photo,
    FittedPhoto: _decode_fitted_photo,
    Timeline: _decode_timeline,
}


@cache
def _kinds(kind: Any) -> dict[str, Any]:
    """The types of the fields; finding them takes long."""
    return get_type_hints(kind)


@cache
def _names(kind: Any) -> tuple[str, ...]:
    return tuple(one.name for one in fields(kind)) if is_dataclass(kind) else kind._fields


def _encode_fields(value: Any, parts: Parts) -> dict:
    return {name: encode(getattr(value, name), parts) for name in _names(value.__class__)}


def _decode_fields(kind: Any, about: dict, parts: Parts) -> Any:
    kinds = _kinds(kind)
    return kind(**{name: decode(kinds[name], about[name], parts) for name in _names(kind) if name in about})


def _checked(value: Any, kind: Any) -> Any:
    if not isinstance(value, kind) or (kind is not bool and isinstance(value, bool)):
        raise ValueError(f"{type(value).__name__} where {kind.__name__} was expected")
    return value
