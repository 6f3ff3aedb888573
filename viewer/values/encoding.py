"""Frozen values as JSON by the types of their fields; large values are stored once, by number."""

import io
from collections.abc import Callable
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import AbstractArray
from PIL import Image
from torch import Tensor

from core.edits.edit import Edit
from core.edits.kinds import edits_json, read_edits
from core.fitting.fit import FitStep, Hypothesis
from core.geometry.pixels import to_bytes
from core.models.codes import Codes
from core.models.missing import MissingInstance, adopted
from core.models.model import Instance
from core.models.open_models import OpenModels
from core.models.photo_detail import Erasure, PhotoDetail, PhotoView, decompressed
from core.models.scene import Scene
from core.photos.detector import Box
from core.photos.photo import Photo
from core.runtime.numbers import whole
from core.runtime.reading import field_types, first_line, open_image, reading, typed
from viewer.values.cut_out_preview import CutOutPreview, read_compressed
from viewer.values.fit_history import FitRequest, FittedPhoto
from viewer.values.objects import EditableObject


class Original(NamedTuple):
    """A project file of which something could not be read, kept as it was."""

    name: str  # of the file
    reasons: tuple[str, ...]  # why something could not be read, each once
    content: bytes


_SHARED = PhotoView, Erasure  # types of values shared by many undo states
_OF_AN_INSTANCE = Scene, EditableObject, FitStep, Hypothesis
"""Types with a field ``instance``, which files call ``codes``: codes with the fingerprint of their model."""
_SEPARATE = EditableObject, FitRequest, Original  # types of items of which an unreadable one leaves the others
_MAX_PHOTO, _MAX_PHOTOS = 16_000_000, 64_000_000  # bytes of RGBA pixels: of one photo, and of all photos


@dataclass(eq=False)
class BlobStore:
    """Values that JSON refers to by number: arrays, photos, and values shared by many states."""

    tensors: list[Tensor] = field(default_factory=list)
    photos: list[bytes] = field(default_factory=list)  # PNG with the mask as opacity; WebP of photo detail; originals
    timelines: list[Any] = field(default_factory=list)
    """Views and erasures of photos: JSON, replaced by values when decoded."""
    models: OpenModels | None = None  # models of decoded codes; None for encoding
    model: str = ""  # fingerprint for codes without one
    left: int = _MAX_PHOTOS  # bytes left for the pixels of photos not yet decoded
    missing: set[str] = field(default_factory=set)  # fingerprints of decoded codes whose model is missing
    unreadable: list[str] = field(default_factory=list)  # reasons why values were left out, one for each
    _known: dict[int, tuple[object, int]] = field(default_factory=dict)  # stored values and their numbers, by id

    def number(self, value: object, stored: list, make: Callable[[], Any]) -> int:
        """Return a value's number in the list ``stored``; a new value is made by ``make`` and appended."""
        if id(value) not in self._known:
            made = make()
            self._known[id(value)] = value, len(stored)
            stored.append(made)
        return self._known[id(value)][1]


def encode(value: Any, store: BlobStore) -> Any:
    """Encode a value as JSON; large values are added to ``store``."""
    if isinstance(value, Tensor):
        return store.number(value, store.tensors, lambda: value.detach().cpu().contiguous())
    if isinstance(value, _SHARED):
        return store.number(value, store.timelines, lambda: _encode_shared(value, store))
    if isinstance(value, Photo):
        image = store.number(value, store.photos, lambda: encode_photo(value))
        fine = value.fine and store.number(value.fine, store.photos, lambda: value.fine)
        return {"image": image, "fine": fine} | {name: encode(getattr(value, name), store) for name in _BESIDE_IMAGE}
    if isinstance(value, Instance):
        latents = _encode_fields(replace(value.codes, edits=()), store)
        del latents["edits"]
        return latents | edits_json(value.codes.edits) | {"model": value.fingerprint}
    if isinstance(value, FittedPhoto):
        return {"source": encode(value.source, store), "photo": encode(value.photo, store)} | _encode_preview(
            value, store
        )
    if isinstance(value, Original):
        content = store.number(value.content, store.photos, lambda: value.content)
        return {"name": value.name, "reasons": value.reasons, "content": content}
    if is_dataclass(value) or hasattr(value, "_fields"):
        return _encode_fields(value, store)
    if isinstance(value, tuple | frozenset):
        return [encode(item, store) for item in (sorted(value) if isinstance(value, frozenset) else value)]
    return str(value) if isinstance(value, Path) else value


def _encode_shared(value: Any, store: BlobStore) -> Any:
    record = _encode_fields(value, store)
    if isinstance(value, PhotoView):
        record["image"] = store.number(value.image, store.photos, lambda: value.image)
    return record


def _encode_preview(fitted: FittedPhoto, store: BlobStore) -> dict:
    if (preview := fitted.preview) is None:
        return {}
    image = store.number(preview, store.photos, lambda: preview.compressed)
    return {"preview": image, "boxes": encode(preview.boxes, store)}


def decode(kind: Any, value: Any, store: BlobStore) -> Any:
    """Decode a value of type ``kind``, the inverse of :func:`encode`; missing fields get their defaults.

    Raises ``ValueError`` for other content.
    """
    return typed(kind, value, lambda inner: _reader(inner, store), getattr(kind, "__name__", "it"))


def _reader(kind: Any, store: BlobStore) -> Callable[[Any], Any] | None:
    """Return the decoder of a type that JSON lacks."""
    if kind in _SPECIAL:
        return lambda value: _SPECIAL[kind](value, store)
    if isinstance(kind, type) and issubclass(kind, AbstractArray):
        return lambda number: _tensor(_part(store.tensors, number), kind)
    return None


def readable(store: BlobStore, read: Callable[[], Any]) -> Any:
    """Return the value of ``read``; None if it raises, for a reason that is noted in the store."""
    try:
        return read()
    except Exception as error:
        store.unreadable.append(first_line(error))
        return None


def _decode_separately(kind: Any, values: Any, store: BlobStore) -> tuple[Any, ...]:
    """Decode a list, leaving out unreadable items."""
    listed = readable(store, partial(typed, list, values, name=kind.__name__)) or []
    items = (readable(store, partial(decode, kind, value, store)) for value in listed)
    return tuple(item for item in items if item is not None)


def encode_photo(photo: Photo) -> bytes:
    """Encode a photo as PNG with its mask as opacity."""
    pixels = to_bytes(photo.pixels)
    file = io.BytesIO()
    Image.fromarray(np.dstack((pixels, 255 * photo.mask.numpy().astype(np.uint8)))).save(file, "PNG")
    return file.getvalue()


def decode_photo(file: bytes, most: int = _MAX_PHOTO, **beside: Any) -> Photo:
    """Decode a photo, the inverse of :func:`encode_photo`. Raises ``ValueError`` for other files.

    Args:
        most: limit of the decoded pixels in bytes.
        beside: the photo's other fields.
    """
    with reading("its photo", "an image"), open_image(io.BytesIO(file), most=most) as image:
        rgba = torch.from_numpy(np.array(image.convert("RGBA")))
        return Photo(rgba[..., :3].float() / 255, rgba[..., 3] > 127, **beside)


_BESIDE_IMAGE = (
    *("camera", "cropped", "scaled", "unseen", "opacity", "edge_error", "focal", "blur", "mask_confidence"),
    "side",
)  # fields of a photo that a PNG cannot store


def _decode_photo(record: Any, store: BlobStore) -> Photo:
    kinds = field_types(Photo)
    beside = {name: decode(kinds[name], record[name], store) for name in _BESIDE_IMAGE if name in record}
    photo = decode_photo(_part(store.photos, record["image"]), min(_MAX_PHOTO, store.left), **beside)
    store.left -= 4 * photo.mask.numel()
    if record.get("fine") is None:
        return photo
    fine = _part(store.photos, record["fine"])
    decompressed(fine)  # raises if damaged
    return replace(photo, fine=fine)


def _decode_view(record: dict, store: BlobStore) -> PhotoView:
    kinds = field_types(PhotoView)
    beside = {name: decode(kinds[name], record[name], store) for name in kinds if name in record and name != "image"}
    view = PhotoView(_part(store.photos, record["image"]), **beside)
    view.pixels()  # raises if damaged
    return view


def _decode_fitted_photo(record: Any, store: BlobStore) -> FittedPhoto:
    source = decode(field_types(FittedPhoto)["source"], record["source"], store)
    preview = readable(store, partial(_decode_preview, record, store)) if "preview" in record else None
    return FittedPhoto.of(source, _decode_photo(record["photo"], store), preview)


def _decode_preview(record: Any, store: BlobStore) -> CutOutPreview:
    pixels = read_compressed(_part(store.photos, record["preview"]))
    return CutOutPreview(pixels, decode(tuple[Box, ...], record.get("boxes", []), store))


def _decode_original(record: Any, store: BlobStore) -> Original:
    record = typed(dict, record, name="original")
    reasons = decode(tuple[str, ...], record["reasons"], store)
    return Original(str(record["name"]), reasons, _part(store.photos, record["content"]))


def _decode_instance(record: Any, store: BlobStore) -> Instance:
    """Decode an object of its open model or of one that extends it; without a model if that is missing.

    Raises ``ValueError`` if the codes do not fit their model.
    """
    fingerprint = typed(str, typed(dict, record, name="codes").get("model", ""), name="codes.model") or store.model
    instance = MissingInstance(fingerprint, _decode_in_place(Codes, record | {"edits": record}, store))
    assert store.models is not None, "no models"
    if model := store.models.find(fingerprint):
        return adopted(model, instance)
    store.missing.add(fingerprint)
    return instance


def _decode_shared(kind: Any, record: Any, store: BlobStore) -> Any:
    """Return the same value for the same number. Some files of November 2026 hold the JSON in its place."""
    if isinstance(record, dict):
        return _decode_in_place(kind, record, store)
    value = _part(store.timelines, record)
    if not isinstance(value, kind):
        value = store.timelines[record] = _decode_in_place(kind, value, store)
    return value


def _decode_in_place(kind: Any, record: Any, store: BlobStore) -> Any:
    if kind is PhotoView:
        return _decode_view(typed(dict, record, name="view"), store)
    if kind in _OF_AN_INSTANCE and isinstance(record, dict):
        record = {"instance" if name == "codes" else name: value for name, value in record.items()}
    return typed(kind, record, lambda inner: None if inner is kind else _reader(inner, store), kind.__name__.lower())


def _part(stored: list, number: Any) -> Any:
    """Look up a stored value by number."""
    if not 0 <= whole(number) < len(stored):
        raise ValueError(f"part {number} is missing")
    return stored[whole(number)]


_SPECIAL: dict[Any, Callable[[Any, BlobStore], Any]] = {
    Photo: _decode_photo,
    FittedPhoto: _decode_fitted_photo,
    PhotoDetail: lambda record, store: readable(store, partial(_decode_in_place, PhotoDetail, record, store)),
    Original: _decode_original,
    Instance: _decode_instance,
    tuple[Edit, ...]: lambda record, store: read_edits(record),
}
_SPECIAL |= {kind: partial(_decode_in_place, kind) for kind in _OF_AN_INSTANCE}
_SPECIAL |= {kind: partial(_decode_shared, kind) for kind in _SHARED}
_SPECIAL |= {tuple[kind, ...]: partial(_decode_separately, kind) for kind in _SEPARATE}  # type: ignore[valid-type]


@cache
def _names(kind: Any) -> tuple[str, ...]:
    return tuple(item.name for item in fields(kind)) if is_dataclass(kind) else kind._fields


def _encode_fields(value: Any, store: BlobStore) -> dict:
    fields_json = {name: encode(getattr(value, name), store) for name in _names(value.__class__)}
    return {"codes" if name == "instance" else name: field_json for name, field_json in fields_json.items()}


def _tensor(value: Any, kind: Any) -> Any:
    if isinstance(value, kind):
        return value
    raise ValueError(f"a tensor of shape {tuple(value.shape)} where {kind.__name__} was expected")
