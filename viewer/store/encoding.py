"""Frozen values as JSON by the types of their fields; large and shared parts are contents of their own."""

import io
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import AbstractArray
from PIL import Image
from torch import Tensor

from core.edits.edit import Edit
from core.edits.kinds import edits_json, read_edits
from core.geometry.pixels import to_bytes
from core.models.codes import Codes
from core.models.missing import MissingInstance
from core.models.model import Instance
from core.models.photo_detail import Erasure, PhotoDetail, PhotoView, decompressed
from core.photos.detector import Box
from core.photos.photo import Photo
from core.runtime.numbers import whole
from core.runtime.reading import field_types, open_image, optional, read_bytes, reading, typed
from viewer.store.blobs import Blobs
from viewer.values.cut_out_preview import CutOutPreview, read_compressed
from viewer.values.fit_history import FittedPhoto, PhotoSource

_NOTED = Instance, PhotoView, FittedPhoto  # types of which values in memory are not stored again
_SHARED = *_NOTED, Erasure  # types that many values share: JSON of their own
_IN_IMAGE = "pixels", "mask"  # fields of a photo that a PNG stores
_MAX_PHOTO, _MAX_PHOTOS = 16_000_000, 64_000_000  # bytes of RGBA pixels: of one photo, and of all photos
_MAX_TENSOR = 64_000_000  # bytes


def put(blobs: Blobs, value: Any) -> int:
    """Store a value as JSON with its parts, and return the number of the JSON."""
    is_noted = isinstance(value, _NOTED)
    if is_noted and (number := blobs.numbers.get(value)) is not None:
        return number
    encoder = Encoder(blobs)
    content = json.dumps(encoder.encode(value, whole=True))
    number = blobs.add(content, encoder.parts)
    if is_noted:
        blobs.numbers[value] = number
    return number


WriteFile = Callable[[bytes, str], Path | None]  # writes the copy of a photo's file, by content and name


class Encoder:
    """Encodes a value as JSON; large and shared values are added to the contents of a database."""

    def __init__(self, blobs: Blobs) -> None:
        self._blobs = blobs
        self.parts = set[int]()  # numbers of the contents that the JSON refers to

    def encode(self, value: Any, whole: bool = False) -> Any:
        """Encode a value; ``whole`` encodes one of a shared type itself, not the number of its content."""
        if isinstance(value, _SHARED) and not whole:
            return self._part(put(self._blobs, value))
        if isinstance(value, Tensor):
            array = value.detach().cpu().contiguous().numpy()
            return {"dtype": array.dtype.str, "shape": array.shape, "content": self._content(array.tobytes())}
        if isinstance(value, bytes):
            return self._content(value)
        if isinstance(value, Path):
            return str(value)
        if type(value) in _ENCODERS:
            return _ENCODERS[type(value)](self, value)
        if isinstance(value, Instance):
            latents = self.fields(value.codes, *(name for name in _names(Codes) if name != "edits"))
            return latents | edits_json(value.codes.edits) | {"model": value.fingerprint}
        if is_dataclass(value) or hasattr(value, "_fields"):
            return self.fields(value)
        if isinstance(value, tuple | frozenset):
            return [self.encode(item) for item in (sorted(value) if isinstance(value, frozenset) else value)]
        return value

    def fields(self, value: Any, *names: str) -> dict[str, Any]:
        """Encode fields of a value by name, by default all."""
        return {name: self.encode(getattr(value, name)) for name in names or _names(value.__class__)}

    def _content(self, content: bytes) -> int:
        return self._part(self._blobs.add(content))

    def _part(self, number: int) -> int:
        self.parts.add(number)
        return number

    def photo(self, photo: Photo) -> dict[str, Any]:
        """Encode a photo, its pixels as an image."""
        return {"image": self._content(encode_photo(photo))} | self.fields(photo, *_BESIDE_IMAGE)

    def preview(self, preview: CutOutPreview) -> dict[str, Any]:
        """Encode a whole photo as a smaller image."""
        return self.fields(preview, "compressed", "boxes")

    def source(self, source: PhotoSource) -> dict[str, Any]:
        """Encode a photo to fit with its file, if there is a copy; then a name does in place of its path."""
        content = optional(lambda: read_bytes(source.file)) if source.copy else None
        if not isinstance(content, bytes):
            return self.fields(source._replace(copy=None))
        record = self.fields(source._replace(copy=None, path=Path(source.path.name)))
        return record | {"file": self._content(content), "file_name": source.file.name}


_ENCODERS: dict[Any, Callable[[Encoder, Any], dict[str, Any]]] = {
    Photo: Encoder.photo,
    CutOutPreview: Encoder.preview,
    PhotoSource: Encoder.source,
}


class Decoder:
    """Decodes values of a database. Equal parts are one object; objects are of no model yet."""

    def __init__(self, blobs: Blobs, files: WriteFile | None = None) -> None:
        """Decode contents of ``blobs``; ``files`` writes the copies of photos; None writes none."""
        self._blobs = blobs
        self._files = files or (lambda content, name: None)
        self._values: dict[tuple, Any] = {}
        self._left = _MAX_PHOTOS  # bytes left for the pixels of photos not yet decoded

    def value(self, kind: Any, number: Any) -> Any:
        """Return a value by the number of its content, the same for the same number; ``ValueError`` for others."""
        key = kind, whole(number)
        if key not in self._values:
            self._values[key] = self.decode(kind, self._blobs.record(key[1]), whole_value=True)
        return self._values[key]

    def decode(self, kind: Any, record: Any, whole_value: bool = False) -> Any:
        """Decode a value of type ``kind``, the inverse of :meth:`Encoder.encode`; missing fields get their defaults.

        Raises ``ValueError`` for other content.
        """
        if whole_value and kind is Instance:
            return self._instance(record)
        inner = partial(self._reader, excluded=kind if whole_value else None)
        value = typed(kind, record, inner, getattr(kind, "__name__", "it").lower())
        if isinstance(value, PhotoView):
            value.pixels()  # raises if damaged
        return value

    def _reader(self, kind: Any, _: str = "", excluded: Any = None) -> Callable[[Any], Any] | None:
        """Return the decoder of a type that JSON lacks."""
        if kind is excluded:
            return None
        if kind in _SHARED:
            return partial(self.value, kind)
        if kind is bytes:
            return self._bytes
        if isinstance(kind, type) and issubclass(kind, AbstractArray):
            return partial(self._tensor, kind)
        return partial(_DECODERS[kind], self) if kind in _DECODERS else None

    def _bytes(self, number: Any) -> bytes:
        key = bytes, whole(number)
        if key not in self._values:
            self._values[key] = self._blobs.content(key[1], bytes)
        return self._values[key]

    def _tensor(self, kind: Any, record: Any) -> Any:
        record = typed(dict, record, name="tensor")
        shape = typed(tuple[int, ...], record.get("shape"), name="shape")
        dtype = np.dtype(typed(str, record.get("dtype"), name="dtype"))
        content = self._bytes(record.get("content"))
        if dtype.kind not in "bfiu" or len(content) > _MAX_TENSOR:
            raise ValueError("no numbers of a tensor")
        value = self._values.setdefault(
            (dtype, shape, record["content"]), torch.from_numpy(np.frombuffer(content, dtype).reshape(shape).copy())
        )
        if isinstance(value, kind):
            return value
        raise ValueError(f"a tensor of shape {shape} where {kind.__name__} was expected")

    def _instance(self, record: Any) -> Instance:
        record = typed(dict, record, name="codes")
        codes = typed(Codes, record | {"edits": record}, self._reader, "codes")
        return MissingInstance(typed(str, record.get("model"), name="model"), codes)

    def _photo(self, record: Any) -> Photo:
        kinds = field_types(Photo)
        fields = {name: self.decode(kinds[name], record[name]) for name in _BESIDE_IMAGE if name in record}
        photo = decode_photo(self._bytes(record["image"]), min(_MAX_PHOTO, self._left), **fields)
        self._left -= 4 * photo.mask.numel()
        if photo.fine:
            decompressed(photo.fine)  # raises if damaged
        return photo

    def _preview(self, record: Any) -> CutOutPreview | None:
        """Decode the whole photo; None if it is damaged, as the fit can do without."""

        def decoded() -> CutOutPreview:
            pixels = read_compressed(self._bytes(record["compressed"]))
            return CutOutPreview(pixels, self.decode(tuple[Box, ...], record["boxes"]))

        return optional(decoded)

    def _source(self, record: Any) -> PhotoSource:
        key = PhotoSource, repr(record)
        if key not in self._values:  # a fitted photo's source is that of its history
            # A copy is of this machine: a project's own path must not name another file as its photo.
            source = typed(PhotoSource, record, name="source")._replace(copy=None)
            name = Path(record.get("file_name") or "").name
            if name not in ("", ".."):
                with suppress(ValueError, OSError):
                    source = source._replace(copy=self._files(self._bytes(record.get("file")), name))
            self._values[key] = source
        return self._values[key]

    def _detail(self, record: Any) -> PhotoDetail | None:
        """Decode photo detail; None if a part of it is damaged, as the object can do without."""
        return optional(lambda: typed(PhotoDetail, record, partial(self._reader, excluded=PhotoDetail), "detail"))


_DECODERS: dict[Any, Callable[[Decoder, Any], Any]] = {
    Photo: Decoder._photo,
    CutOutPreview: Decoder._preview,
    PhotoSource: Decoder._source,
    PhotoDetail: Decoder._detail,
    tuple[Edit, ...]: lambda _, record: read_edits(record),
}


def encode_photo(photo: Photo) -> bytes:
    """Encode a photo as PNG with its mask as opacity."""
    pixels = to_bytes(photo.pixels)
    file = io.BytesIO()
    Image.fromarray(np.dstack((pixels, 255 * photo.mask.numpy().astype(np.uint8)))).save(file, "PNG")
    return file.getvalue()


def decode_photo(file: bytes, limit: int = _MAX_PHOTO, **fields: Any) -> Photo:
    """Decode the file of :func:`encode_photo`. Raises ``ValueError`` for others, or above ``limit`` bytes of pixels."""
    with reading("its photo", "an image"), open_image(io.BytesIO(file), limit=limit) as image:
        rgba = torch.from_numpy(np.array(image.convert("RGBA")))
        return Photo(rgba[..., :3].float() / 255, rgba[..., 3] > 127, **fields)


@cache
def _names(kind: Any) -> tuple[str, ...]:
    return tuple(item.name for item in fields(kind)) if is_dataclass(kind) else kind._fields


_BESIDE_IMAGE = tuple(name for name in _names(Photo) if name not in _IN_IMAGE)  # fields that a PNG lacks
