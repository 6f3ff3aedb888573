"""Colours of HDR and other encodings, converted to sRGB by the file's colour numbers (ITU-T H.273) or its gamma."""

import struct
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from PIL import Image
from PIL.ImageFile import ImageFile

from core.runtime.reading import optional

_WHITE = 203.0  # cd/m2 of diffuse white in HDR (ITU-R BT.2408), which becomes white
_HLG_PEAK = 1000.0  # cd/m2 of the display for which the system gamma is 1.2 (ITU-R BT.2100)
_LUMINANCE = np.array((0.2627, 0.678, 0.0593))  # of BT.2020's primaries
_SRGB_GAMMA = 0.45455  # exponent of the encoding that stands for sRGB in a PNG
_SAME_GAMMA = 0.05  # relative tolerance


class Encoding(NamedTuple):
    """An encoding of colours: numbers of primaries and transfer curve, or a gamma (exponent of the encoding)."""

    primaries: int
    transfer: int
    gamma: float | None = None
    narrow: bool = False  # black is 16 and white 235


def colour_encoding(image: Image.Image) -> Encoding | None:
    """Return the encoding of an opened image, before its pixels are read; None if it is sRGB, or a profile tells."""
    read = _READERS.get(image.format)
    numbers = optional(lambda: read(image)) if read and isinstance(image, ImageFile) else None
    primaries, transfer, narrow = numbers or _SRGB
    if primaries not in _TO_SRGB or transfer not in _CURVES:
        primaries, transfer, _ = _SRGB
    if transfer in HDR or narrow:
        return Encoding(primaries, transfer, narrow=narrow)
    if "icc_profile" in image.info:
        return None
    if primaries != _SRGB[0] or transfer not in _LIKE_SRGB:
        return Encoding(primaries, transfer)
    gamma = image.info.get("gamma", _SRGB_GAMMA)
    if numbers or "srgb" in image.info or abs(gamma / _SRGB_GAMMA - 1) < _SAME_GAMMA or not gamma > 0:
        return None
    return Encoding(*_SRGB[:2], gamma)


def decoded(image: Image.Image, encoding: Encoding) -> Image.Image:
    """Return an RGBA image in sRGB; colours brighter than white become white."""
    levels = np.linspace(0, 1, 256)
    if encoding.narrow:
        levels = ((levels - 16 / 255) * (255 / 219)).clip(0, 1)
    curve = levels ** (1 / encoding.gamma) if encoding.gamma else _CURVES[encoding.transfer](levels)
    values = np.asarray(image)
    linear = curve[values[..., :3]]
    if encoding.transfer == _HLG:
        linear *= (_HLG_PEAK / _WHITE) * (linear @ _LUMINANCE)[..., None] ** 0.2
    linear = (linear @ _TO_SRGB[encoding.primaries].T).clip(0, 1)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return Image.fromarray(np.concatenate(((srgb * 255 + 0.5).astype(np.uint8), values[..., 3:]), -1))


# Numbers in files


def _png_numbers(image: ImageFile) -> tuple[int, int, bool] | None:
    """Return primaries and transfer of the chunk cICP, and whether its range is narrow; None without it."""
    file = image.fp
    assert file is not None
    position = file.tell()
    try:
        file.seek(8)
        while True:
            length, kind = struct.unpack(">I4s", file.read(8))
            if kind == b"cICP":
                primaries, transfer, _, full_range = file.read(4)
                return primaries, transfer, full_range == 0
            if kind == b"IDAT":
                return None
            file.seek(length + 4, 1)
    finally:
        file.seek(position)


def _avif_numbers(image: ImageFile) -> tuple[int, int, bool]:
    """Return the numbers of an AVIF, whose container libheif reads without a decoder."""
    from pillow_heif import open_heif  # takes 50 ms, and few images need it

    file = image.fp
    assert file is not None
    position = file.tell()
    try:
        file.seek(0)
        return _of_profile(open_heif(file).info)
    finally:
        file.seek(position)


def _of_profile(info: Mapping[Any, Any]) -> tuple[int, int, bool]:
    """Return primaries and transfer as libheif describes them; its pixels have the full range."""
    profile = info["nclx_profile"]
    return int(profile["color_primaries"]), int(profile["transfer_characteristics"]), False


_READERS: dict[str | None, Callable[[ImageFile], tuple[int, int, bool] | None]] = {
    "PNG": _png_numbers,
    "AVIF": _avif_numbers,
    "HEIF": lambda image: _of_profile(image.info),
}


# Curves from encoded values to linear light, 1 at white


def _srgb(levels: Float[np.ndarray, "levels"]) -> Float[np.ndarray, "levels"]:
    return np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)


def _pq(levels: Float[np.ndarray, "levels"]) -> Float[np.ndarray, "levels"]:
    """Return the light of SMPTE ST 2084."""
    power = levels ** (1 / 78.84375)
    ratio = np.maximum(power - 0.8359375, 0) / (18.8515625 - 18.6875 * power)
    return 10_000 / _WHITE * ratio ** (1 / 0.1593017578125)


def _hlg(levels: Float[np.ndarray, "levels"]) -> Float[np.ndarray, "levels"]:
    """Return the scene's light, 1 at the peak, of ARIB STD-B67; the system gamma follows in :func:`decoded`."""
    return np.where(levels <= 0.5, levels**2 / 3, (np.exp((levels - 0.55991073) / 0.17883277) + 0.28466892) / 12)


_HLG = 18
HDR = (16, _HLG)  # transfer curves of BT.2100
BT2020 = 9  # primaries
_LIKE_SRGB = (1, 6, 13, 14, 15)  # video's curves are shown like sRGB's
_SRGB = (1, 13, False)
_CURVES = dict.fromkeys(_LIKE_SRGB, _srgb) | {
    4: lambda levels: levels**2.2,
    5: lambda levels: levels**2.8,
    8: lambda levels: levels,
    16: _pq,
    _HLG: _hlg,
}
_TO_SRGB = {
    1: np.eye(3),
    BT2020: np.array([(1.6605, -0.5876, -0.0728), (-0.1246, 1.1329, -0.0083), (-0.0182, -0.1006, 1.1187)]),
    12: np.array([(1.2249, -0.2247, 0.0), (-0.0421, 1.0421, 0.0), (-0.0196, -0.0786, 1.0983)]),  # Display P3
}  # matrices between linear colours, by the number of the primaries
