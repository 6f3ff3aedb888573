"""The salient object of an image, by U2-Net-p (Qin et al. 2020)."""

import logging
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from core.runtime.networks import NETWORKS, run_network

_SIDE = 320  # px of the network's input
_MEAN = (0.485, 0.456, 0.406)  # of the colours it was trained on
_STD = (0.229, 0.224, 0.225)


def predict_saliency(image: Image.Image) -> Float[np.ndarray, "height width"] | None:
    """Predict the saliency map (0..1) of an image; None, with a warning, if the network is missing or damaged."""
    small = image.convert("RGB").resize((_SIDE, _SIDE), Image.Resampling.LANCZOS)
    try:
        saliency = _predict(NETWORKS / "u2netp.onnx", small.tobytes())
    except ValueError as error:  # a person can still point out the object
        logging.getLogger(__name__).warning("objects are cut out without the saliency network: %s", error)
        return None
    return np.asarray(Image.fromarray(saliency).resize(image.size, Image.Resampling.LANCZOS), np.float32) / 255


@lru_cache(maxsize=4)
def _predict(path: Path, pixels: bytes) -> UInt8[np.ndarray, "side side"]:
    """Run the network; cached, since every stroke over a photo starts from the same mask."""
    values = np.frombuffer(pixels, np.uint8).reshape(_SIDE, _SIDE, 3).astype(np.float64)
    values = (values / max(values.max(), 1) - _MEAN) / _STD
    outputs = run_network(path, values.transpose(2, 0, 1)[None].astype(np.float32))
    saliency = next(iter(outputs.values()))[0, 0]
    return (255 * (saliency - saliency.min()) / max(saliency.max() - saliency.min(), 1e-6)).astype(np.uint8)
