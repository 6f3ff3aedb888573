"""The salient object of an image, by U2-Net-p (Qin et al. 2020), which comes with the package ``rembg``."""

import importlib.util
from functools import cache
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
    try:
        from rembg import remove

        mask = remove(image.convert("RGB"), session=_session(), only_mask=True)
    except Exception:  # whatever ails it, a person can still point at the object
        return None
    return np.asarray(mask.convert("L"), np.float32) / 255


@cache
def _session() -> Any:
    from rembg import new_session

    return new_session(_NETWORK)
