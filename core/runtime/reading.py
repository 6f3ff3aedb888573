"""Safe reading of files: any parser error becomes one ``ValueError`` naming the file, and memory is limited.

Parsers raise arbitrary exceptions (a truncated AVIF a ``RuntimeError``, a zip an ``EOFError``), so :func:`reading`
catches all of them; no other code lists exceptions. :func:`typed` checks JSON against the types of fields, and a
value's ``__post_init__`` checks the rest. Nothing is decoded that could exceed :data:`MAX_DECODED`.
"""

import json
import pickle
import types
import warnings
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Union, get_args, get_origin, get_type_hints

from PIL import Image, PngImagePlugin

from core.runtime.numbers import abbreviated, number, whole
from core.runtime.pipes import refuse_pipe
from core.runtime.process import SharedContext
from core.runtime.raw_previews import raw_preview

if TYPE_CHECKING:
    from torch import Tensor

MAX_DECODED = 400_000_000  # bytes of a decoded file, judged by its header: an RGB image of 100 megapixels
MAX_TEXT = 16_000_000  # bytes of JSON or numbers as text; Python objects take up to twenty times as much
_MAX_MEMBERS = 10_000  # files in a zip
_MAX_PAGES = 100  # pages of a TIFF that are examined
_MAX_MESSAGE, _MAX_REASON = 200, 100  # characters of an error, and of its reason after a long path
_MAX_PATH = 4096  # characters of the longest path; a longer text names no file
_FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "BMP", "GIF", "PPM", "JPEG2000", "AVIF")
"""Supported image formats, besides HEIF. Pillow's others are refused: its EPS reader starts another program."""
_HEIF_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
_COPIED = ("WEBP", "AVIF", "HEIF")  # formats whose decoders hold a second copy of the pixels
_STORED = {"1": 1, "L": 1, "P": 1, "I;16": 2, "I;16B": 2, "I;16L": 2}  # bytes per pixel by Pillow's mode; else 4
_COEFFICIENTS = 3  # further bytes per pixel of a progressive JPEG, at its full size

# Pillow refuses photographs with a colour profile or description over a megabyte.
PngImagePlugin.MAX_TEXT_CHUNK = max(PngImagePlugin.MAX_TEXT_CHUNK, MAX_TEXT)


class TooLargeError(ValueError):
    """A file exceeds this program's limits."""


@contextmanager
def reading(path: Path | str, kind: str = "a file") -> Iterator[None]:
    """Turn any exception inside into a one-line ``ValueError`` naming the file; the cause is kept.

    Args:
        kind: kind of file with its article, such as "an image".

    Example:
        >>> with reading("chair.json", "a scene"):
        ...     json.loads("{")
        Traceback (most recent call last):
        ValueError: chair.json: not a scene that can be read (Expecting property name enclosed in double quotes: ...
    """
    try:
        refuse_pipe(Path(path))
        yield
    except Exception as error:
        named = isinstance(error, ValueError) and str(path) in str(error)
        text = str(error) if named else _reason(error, path, kind)
        if named and len(text) <= _most(path):
            raise
        raise ValueError(shortened(text, _most(path))) from error


def shortened(text: str, length: int) -> str:
    """Shorten a text to ``length`` characters, keeping its beginning and its last 30."""
    return text if len(text) <= length else f"{text[: length - 33]}...{text[-30:]}"


def _most(path: Path | str) -> int:
    """Return the character limit of an error about a file."""
    return max(_MAX_MESSAGE, min(len(str(path)), _MAX_PATH) + _MAX_REASON)


def _reason(error: Exception, path: Path | str, kind: str) -> str:
    if isinstance(error, FileNotFoundError):
        if Path(path).parts[:1] in (("http:",), ("https:",)):
            return f"{path} is an address: save {kind} from there, and give the path of the file"
        return f"no such {kind.partition(' ')[2]}: {error.filename or path}"
    if isinstance(error, IsADirectoryError):
        return f"{path} is a folder, not {kind}"
    if isinstance(error, OSError) and error.errno:
        return f"cannot read {path}: {error.strerror}"
    if isinstance(error, MemoryError):
        return f"{path}: too large for this machine's memory"
    if isinstance(error, ValueError) and not isinstance(error, json.JSONDecodeError | UnicodeError):
        return f"{path}: {first_line(error)}"
    return f"{path}: not {kind} that can be read ({first_line(error)})"


def first_line(error: Exception) -> str:
    """Return an exception's message in one line."""
    if isinstance(error, RecursionError):
        return "nested too deeply"
    if isinstance(error, pickle.UnpicklingError):  # torch's text advises executing the file's content
        return "it holds something else than tensors, or is damaged"
    first, *more = [line.strip() for line in str(error).splitlines() if line.strip()] or [type(error).__name__]
    return f"{first} {more[0]}" if first.endswith(":") and more else first


def optional(read: Callable[[], Any]) -> Any:
    """Return the value of ``read``, or None if it raises: for optional parts of a file, such as EXIF."""
    try:
        return read()
    except Exception:
        return None


# Text and JSON


def read_bytes(path: Path, limit: int = MAX_DECODED) -> bytes:
    """Read a file's content. Raises ``TooLargeError`` for more than ``limit`` bytes."""
    refuse_pipe(path)
    with path.open("rb") as file:
        content = file.read(limit + 1)
    if len(content) > limit:
        raise TooLargeError(f"a file of this kind has at most {limit / 1e6:.0f} MB")
    return content


def read_text(path: Path) -> str:
    """Read a file's text: UTF-8, with or without a byte order mark."""
    return read_bytes(path, MAX_TEXT).decode("utf-8-sig")


def parse_json(text: bytes | str) -> Any:
    """Parse JSON in UTF-8, UTF-16 or UTF-32, with or without a byte order mark."""
    if len(text) > MAX_TEXT:
        raise TooLargeError(f"JSON has at most {MAX_TEXT / 1e6:.0f} MB here")
    return json.loads(text.removeprefix("\ufeff") if isinstance(text, str) else text)


def read_json(path: Path) -> Any:
    """Read a file's JSON."""
    return parse_json(read_bytes(path, MAX_TEXT))


def read_numbers(path: Path, count: int) -> tuple[float, ...]:
    """Read a text file of ``count`` finite numbers."""
    words = read_text(path).split()
    if len(words) != count:
        raise ValueError(f"expected {count} numbers, got {len(words)}")
    return tuple(number(float(word)) for word in words)


# Values of a type


def typed(
    kind: Any,
    value: Any,
    special: Callable[[Any, str], Callable[[Any], Any] | None] = lambda *_: None,
    name: str = "it",
) -> Any:
    """Convert JSON to a value of a type: numbers, texts, paths, choices, tuples, dictionaries and dataclasses.

    Named tuples count as dataclasses. Missing fields get their defaults; unknown ones are ignored.

    Args:
        special: maps a type and the value's name to its own reader, which takes precedence; to None for types
            without one.
        name: name of the value in errors.

    Raises ``ValueError`` naming the field or item of the wrong type.

    Example:
        >>> typed(tuple[int, ...], [1, 2.0])
        (1, 2)
    """
    if (read := special(kind, name)) is not None:
        return read(value)
    origin = get_origin(kind)
    arguments = get_args(kind)
    if origin in (Union, types.UnionType):
        (present,) = (argument for argument in arguments if argument is not types.NoneType)
        return None if value is None else typed(present, value, special, name)
    if origin is Literal:
        return _choice(value, arguments, name)
    if origin in (tuple, frozenset):
        return origin(_items(origin, arguments, value, special, name))
    if origin is dict:
        entries = _of_type(value, dict, name).items()
        return {key: typed(arguments[1], entry, special, f"{name}.{key}") for key, entry in entries}
    if is_dataclass(kind) or hasattr(kind, "_fields"):
        return _with_fields(kind, _of_type(value, dict, name), special, name)
    if kind in _SIMPLE:
        return _SIMPLE[kind](value, name)
    return _of_type(value, kind, name)


def _items(origin: Any, arguments: tuple, value: Any, special: Any, name: str) -> Iterator[Any]:
    items = _of_type(value, list, name)
    kinds = arguments[:1] * len(items) if origin is frozenset or arguments[-1] is ... else arguments
    if len(kinds) != len(items):
        raise ValueError(f"{name} has {len(kinds)} parts, got {len(items)}")
    pairs = zip(kinds, items, strict=True)
    return (typed(kind, item, special, f"{name}[{i}]") for i, (kind, item) in enumerate(pairs))


def _with_fields(kind: Any, entries: dict, special: Any, name: str) -> Any:
    kinds = field_types(kind)
    values = {}
    for field, required in _fields(kind):
        if field in entries:
            values[field] = typed(kinds[field], entries[field], special, f"{name}.{field}")
        elif required:
            raise ValueError(f"{name}.{field} is missing")
    return kind(**values)


def _choice(value: Any, choices: tuple, name: str) -> Any:
    for choice in choices:
        if type(choice) is type(value) and choice == value:
            return choice
    raise ValueError(f"{name} must be one of {', '.join(map(str, choices))}, got {abbreviated(value)}")


def _of_type(value: Any, kind: Any, name: str) -> Any:
    if not isinstance(value, kind) or (kind is not bool and isinstance(value, bool)):
        raise ValueError(f"{name} must be {_WORDS.get(kind, kind.__name__)}, got {abbreviated(value)}")
    return value


_WORDS = {dict: "an object", list: "a list", str: "a text", bool: "true or false"}
_SIMPLE: dict[Any, Callable[[Any, str], Any]] = {
    float: number,
    int: whole,
    Path: lambda value, name: Path(_of_type(value, str, name)),
}


@cache
def field_types(kind: Any) -> dict[str, Any]:
    """Return the types of a class's fields; cached, as resolving them is slow."""
    return get_type_hints(kind)


@cache
def _fields(kind: Any) -> tuple[tuple[str, bool], ...]:
    """Return the names of the fields, and True for those without a default."""
    if is_dataclass(kind):
        arguments = [field for field in fields(kind) if field.init]
        return tuple((field.name, field.default is field.default_factory is MISSING) for field in arguments)
    return tuple((name, name not in kind._field_defaults) for name in kind._fields)


# Images, tensors and zip files


@contextmanager
def _our_pillow() -> Iterator[None]:
    """Lift Pillow's limit of pixels, which ignores drafts and modes, and its warnings about damaged metadata."""
    limit = Image.MAX_IMAGE_PIXELS
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        Image.MAX_IMAGE_PIXELS = None
        yield
        Image.MAX_IMAGE_PIXELS = limit


_OUR_PILLOW = SharedContext(_our_pillow)


@contextmanager
def open_image(file: Path | BytesIO, side: int | None = None, limit: int = MAX_DECODED) -> Iterator[Image.Image]:
    """Open an image after checking its header against the memory limit; of a camera raw, its largest preview.

    Args:
        side: px that suffice; a JPEG may be decoded at a fraction of its size.
        limit: limit of the decoded image in bytes.

    Raises ``ValueError`` for other files and for images that are too large; decoding may raise anything.
    """
    if isinstance(file, Path):
        refuse_pipe(file)
    with _OUR_PILLOW, _opened(file) as opened:
        image = raw_preview(opened)
        _seek_largest(image)
        full = image.size
        if side:
            image.draft("RGB", (side, side))
        size = image.width * image.height * _STORED.get(image.mode, 4) * (2 if image.format in _COPIED else 1)
        if image.info.get("progressive"):
            size += full[0] * full[1] * _COEFFICIENTS
        if size > limit:
            raise ValueError(f"the image is too large ({full[0]}x{full[1]} px); make it smaller first")
        yield image


def _opened(file: Path | BytesIO) -> Image.Image:
    try:
        return Image.open(file, formats=(*_FORMATS, "HEIF") if _is_heif(file) else _FORMATS)
    except Image.UnidentifiedImageError:
        raise ValueError("this is not an image (PNG, JPEG, WebP, ...)") from None


def _seek_largest(image: Image.Image) -> None:
    """Go to a TIFF's largest page, as the others are previews. HEIC and MPO name their main image."""
    sizes = []
    with suppress(Exception):  # a damaged page ends the file
        for page in range(min(getattr(image, "n_frames", 1), _MAX_PAGES) if image.format == "TIFF" else 0):
            image.seek(page)
            sizes.append(image.width * image.height)
    if sizes:
        image.seek(sizes.index(max(sizes)))


def _is_heif(file: Path | BytesIO) -> bool:
    """Recognise HEIF by content, and register the format with Pillow."""
    if isinstance(file, Path):
        with file.open("rb") as opened:
            head = opened.read(12)
    else:
        head = file.read(12)
        file.seek(0)
    if head[4:8] != b"ftyp" or head[8:12] not in _HEIF_BRANDS:
        return False
    from pillow_heif import register_heif_opener  # takes 50 ms, and few images need it

    register_heif_opener()
    return True


def read_tensors(path: Path) -> "tuple[dict[str, str], dict[str, Tensor]]":
    """Read the metadata and the tensors of a safetensors file."""
    from safetensors import safe_open

    if path.stat().st_size > MAX_DECODED:
        raise ValueError(f"a file of this kind has at most {MAX_DECODED / 1e6:.0f} MB")
    with safe_open(path, framework="pt") as file:
        return file.metadata() or {}, {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118


@contextmanager
def open_zip(path: Path, limit: int = MAX_DECODED) -> Iterator[zipfile.ZipFile]:
    """Open a zip file. Raises ``TooLargeError`` if it unpacks to more than ``limit`` bytes or too many files."""
    with zipfile.ZipFile(path) as file:
        members = file.infolist()
        if len(members) > _MAX_MEMBERS or sum(member.file_size for member in members) > limit:
            raise TooLargeError(f"it unpacks to more than {_MAX_MEMBERS} files or {limit / 1e6:.0f} MB")
        yield file
