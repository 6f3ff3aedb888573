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

_NETWORK = "u2netp.onnx"  # 4.6 MB
_SIDE = 320  # px of the network's input
_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of the colours it was trained on


def predict_saliency(image: Image.Image) -> Float[np.ndarray, "height width"] | None:
    """Predict the saliency map (0..1) of an image.

    None, with a warning, if the network is missing or damaged. Some distributions of ``rembg`` include it, others fetch
    it once.
    """
    small = image.convert("RGB").resize((_SIDE, _SIDE), Image.Resampling.LANCZOS)
    try:
        found = _predict(network_file(), small.tobytes())
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


def network_file() -> Path:
    """Return the network's file in the package or the user's folder. Raises ``ValueError`` if it cannot be had."""
    package = importlib.util.find_spec("rembg")
    home = Path(os.environ.get("U2NET_HOME") or Path(os.environ.get("XDG_DATA_HOME", "~")) / ".u2net").expanduser()
    places = [Path(package.origin).parent / _NETWORK] if package and package.origin else []
    places.append(home / _NETWORK)
    if not any(place.is_file() for place in places):
        try:
            from rembg import new_session

            new_session(Path(_NETWORK).stem)  # fetches the file
        except Exception as error:
            raise ValueError(f"{_NETWORK} cannot be fetched; put it into {home}") from error
    return next(place for place in places if place.is_file())
