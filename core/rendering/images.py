"""The choice of the renderer: images, videos, photo detail and exports all ask here.

It is the fast renderer. Single images of architectures that it does not support are exact.
"""

from collections.abc import Generator
from typing import Protocol

from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.model import Model
from core.rendering import fast
from core.rendering.reference import Rendered, render_exact
from core.streams import run_to_end

SAMPLES = 192  # intervals along the longest side of the scene's box in a finished image
_EXACT_SAMPLES = 64  # the paper's


class Renderer(Protocol):
    """A renderer in steps: yields None, as often as it can be interrupted, and returns the render."""

    def __call__(
        self, model: Model, codes: Codes, camera: Camera, samples: int, complete: bool = True
    ) -> Generator[None, None, Rendered]:
        """Render with ``samples`` intervals; not ``complete``: a preview of a changing shape, which may be coarser."""


render_steps: Renderer = fast.render_steps
is_cached = fast.is_cached  # tells, for the same arguments, if a render takes the time of colours only


def render_image(model: Model, codes: Codes, camera: Camera, samples: int | None = None) -> Rendered:
    """Render in one call; the authors' checkpoints and the entangled ablations exactly.

    Args:
        samples: intervals; None: those of a finished image, or of the paper.
    """
    if model.white_from_network or model.is_ablation:
        return render_exact(model, codes, camera, samples or _EXACT_SAMPLES)
    return run_to_end(render_steps(model, codes, camera, samples or SAMPLES))
