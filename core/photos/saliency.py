"""The salient object of an image, by U2-Net-p (Qin et al. 2020), which comes with the package ``rembg``."""

import importlib.util
import logging
import os
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

_NETWORK = "u2netp"
"""4.6 MB"""
_SIDE = 320
"""px, what it sees"""
_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""of the colours that it was trained on"""


_CLIP, _TILES = 3.0, 8
"""of the contrast-limited histogram equalisation: how steep it gets, and how many tiles a side"""


def predict_saliency(image: Image.Image, even: bool = False) -> Float[np.ndarray, "height width"] | None:
    """The opacity (0..1) of the object that an image shows; None where ``rembg`` is not installed or fails.

    Args:
        even: local contrast is evened out first (CLAHE, Zuiderveld 1994): dark legs on a dark floor are seen then.

    Some distributions of ``rembg`` bring the network, others fetch it once, which fails on a machine without network.
    """
    colours = image.convert("RGB")
    try:
        if importlib.util.find_spec("rembg") is None:
            return None
        return _predict(colours.size, colours.tobytes(), even)
    except Exception as error:  # whatever ails it, a person can still point at the object
        logging.getLogger(__name__).warning("objects are cut out without the saliency network: %s", error)
        return None


@lru_cache(maxsize=4)
def _predict(size: tuple[int, int], pixels: bytes, even: bool) -> Float[np.ndarray, "height width"]:
    """Cached, as every stroke over a photo begins from it; not to be written to."""
    small = Image.frombytes("RGB", size, pixels).resize((_SIDE, _SIDE), Image.Resampling.LANCZOS)
    values = np.asarray(_even(small) if even else small, np.float64)
    values = (values / max(values.max(), 1) - _MEAN) / _STD
    session = _session(_network_file())
    inputs = {session.get_inputs()[0].name: values.transpose(2, 0, 1)[None].astype(np.float32)}
    found = session.run([session.get_outputs()[0].name], inputs)[0][0, 0]
    found = (found - found.min()) / (found.max() - found.min())
    mask = Image.fromarray((found * 255).astype(np.uint8)).resize(size, Image.Resampling.LANCZOS)
    return np.asarray(mask, np.float32) / 255


def _even(image: Image.Image) -> UInt8[np.ndarray, "height width 3"]:
    import cv2

    lab = cv2.cvtColor(np.asarray(image), cv2.COLOR_RGB2LAB)
    lab[..., 0] = cv2.createCLAHE(_CLIP, (_TILES, _TILES)).apply(lab[..., 0])
    return cv2.cvtColor(lab, cv2.COLOR_LAB2RGB)


@cache
def _session(path: Path) -> Any:
    """The network itself: ``rembg`` around it runs it on all cores, which spin beside other programs, and imports
    OpenCV.
    """
    import onnxruntime  # costs a tenth of a second, and images with alpha or a plain background do not need it

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.enable_cpu_mem_arena = options.enable_mem_pattern = False  # half a gigabyte would be kept for the next run
    return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])


def _network_file() -> Path:
    spec = importlib.util.find_spec("rembg")
    assert spec and spec.origin
    name = f"{_NETWORK}.onnx"
    home = os.environ.get("U2NET_HOME") or Path(os.environ.get("XDG_DATA_HOME", "~")) / ".u2net"
    places = Path(spec.origin).parent / name, Path(home).expanduser() / name
    if not any(place.is_file() for place in places):
        from rembg import new_session

        try:
            new_session(_NETWORK)  # fetches it
        except Exception as error:
            raise ValueError(f"{name} cannot be fetched; put it into {Path(home).expanduser()}") from error
    return next(place for place in places if place.is_file())
