"""The choice of the renderer for images, videos, photo detail and exports: the fast renderer.

Single images that it does not support are rendered exactly.
"""

from core.geometry.camera import Camera
from core.models.model import Instance
from core.rendering import fast
from core.rendering.reference import Rendered, render_exact
from core.runtime.modes import isolated
from core.streams import run_to_end

SAMPLES = 192  # intervals along the longest side of the scene's box in a finished image
_EXACT_SAMPLES = 64  # the paper's

render_steps = fast.render_steps  # yields None wherever it can be abandoned, and returns the render
is_cached = fast.is_cached  # True if a render with the same arguments only evaluates colours


@isolated
def render_image(instance: Instance, camera: Camera, samples: int | None = None) -> Rendered:
    """Render in one call; exactly for the authors' checkpoints and for M1 and M2.

    Args:
        samples: intervals; None: :data:`SAMPLES`, or the paper's 64 if exact.
    """
    if instance.model.white_from_network or instance.model.is_ablation:
        return render_exact(instance, camera, samples or _EXACT_SAMPLES)
    return run_to_end(render_steps(instance, camera, samples or SAMPLES))
