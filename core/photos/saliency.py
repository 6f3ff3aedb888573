"""The salient object of an image, by U2-Net-p (Qin et al. 2020) from the package ``rembg``."""

import importlib.util
import logging
import os
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from core.runtime.networks import run_network

_NETWORK = "u2netp"  # 4.6 MB
_SIDE = 320  # px of the network's input
_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of the colours it was trained on


def predict_saliency(image: Image.Image) -> Float[np.ndarray, "height width"] | None:
    """Predict the saliency map (0..1) of an image; None if ``rembg`` is missing or fails.

    Some distributions of ``rembg`` include the network, others fetch it once, which fails without internet access.
    """
    small = image.convert("RGB").resize((_SIDE, _SIDE), Image.Resampling.LANCZOS)
    try:
        if (path := _network_file()) is None:
            return None
        found = _predict(path, small.tobytes())
    except ValueError as error:  # a person can still point out the object
        logging.getLogger(__name__).warning("objects are cut out without the saliency network: %s", error)
        return None
    return np.asarray(Image.fromarray(found).resize(image.size, Image.Resampling.LANCZOS), np.float32) / 255


@lru_cache(maxsize=4)
def _predict(path: Path, pixels: bytes) -> UInt8[np.ndarray, "side side"]:
    """Run the network; cached, since every stroke over a photo starts from the same mask."""
    values = np.frombuffer(pixels, np.uint8).reshape(_SIDE, _SIDE, 3).astype(np.float64)
    values = (values / max(values.max(), 1) - _MEAN) / _STD
    outputs = run_network(path, values.transpose(2, 0, 1)[None].astype(np.float32))
    found = next(iter(outputs.values()))[0, 0]
    return (255 * (found - found.min()) / max(found.max() - found.min(), 1e-6)).astype(np.uint8)


def _network_file() -> Path | None:
    """Return the file in the package or the user's folder; None without the package. ``ValueError`` if unobtainable."""
    try:
        origin = getattr(importlib.util.find_spec("rembg"), "origin", None)
    except ValueError:  # a blocked package
        origin = None
    if origin is None:
        return None
    name = f"{_NETWORK}.onnx"
    home = os.environ.get("U2NET_HOME") or Path(os.environ.get("XDG_DATA_HOME", "~")) / ".u2net"
    places = Path(origin).parent / name, Path(home).expanduser() / name
    if not any(place.is_file() for place in places):
        from rembg import new_session

        try:
            new_session(_NETWORK)  # fetches the file
        except Exception as error:
            raise ValueError(f"{name} cannot be fetched; put it into {Path(home).expanduser()}") from error
    return next(place for place in places if place.is_file())
