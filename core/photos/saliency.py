"""The salient object of an image, by U2-Net-p (Qin et al. 2020), which comes with the package ``rembg``."""

import importlib.util
import logging
from collections.abc import Callable
from functools import cache, lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float
from PIL import Image

_NETWORK = "u2netp"
"""4.6 MB, 320 px"""


def predict_saliency(image: Image.Image) -> Float[np.ndarray, "height width"] | None:
    """The opacity (0..1) of the object that an image shows; None where ``rembg`` is not installed or fails.

    Some distributions of ``rembg`` bring the network, others fetch it once, which fails on a machine without network.
    """
    if importlib.util.find_spec("rembg") is None:
        return None
    colours = image.convert("RGB")
    try:
        from rembg import remove

        return _predict(remove, colours.size, colours.tobytes())
    except Exception:  # whatever ails it, a person can still point at the object
        logging.getLogger(__name__).warning("the saliency network failed", exc_info=True)
        return None


@lru_cache(maxsize=2)
def _predict(
    remove: Callable[..., Image.Image], size: tuple[int, int], pixels: bytes
) -> Float[np.ndarray, "height width"]:
    """Cached, as every stroke over a photo begins from it; not to be written to."""
    mask = remove(Image.frombytes("RGB", size, pixels), session=_session(), only_mask=True)
    return np.asarray(mask.convert("L"), np.float32) / 255


@cache
def _session() -> Any:
    from rembg import new_session

    return new_session(_NETWORK)
