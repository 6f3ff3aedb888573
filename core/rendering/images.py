"""Render with the fast renderer, or the reference for architectures that it does not support."""

from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.model import Model
from core.rendering.fast import render
from core.rendering.progressive import RenderSettings
from core.rendering.reference import Rendered, render_exact

_EXACT_SAMPLES = 64  # the paper's


def render_image(model: Model, codes: Codes, camera: Camera, samples: int | None = None) -> Rendered:
    """Render with the fast renderer; the authors' checkpoints and the entangled ablations exactly.

    Args:
        samples: intervals; None: those of a finished image, or of the paper.
    """
    if model.white_from_network or model.is_ablation:
        return render_exact(model, codes, camera, samples or _EXACT_SAMPLES)
    return render(model, codes, camera, samples or RenderSettings().samples)
