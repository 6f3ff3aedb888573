"""The available models: shipped ones by name, others by path; and sample images to try them with."""

from functools import cache
from pathlib import Path

from core.models.authors_checkpoint import load_authors
from core.models.model import Model
from core.runtime.precision import require_device

_ASSETS = Path(__file__).resolve().parents[2] / "assets"
SHIPPED = _ASSETS / "models"
DEFAULT_MODEL = "chairs"


def shipped_models() -> tuple[str, ...]:
    """Return the names of the models that come with the program."""
    return tuple(sorted(path.stem for path in SHIPPED.glob("*.safetensors")))


@cache
def sample_images(category: str) -> tuple[Path, ...]:
    """Return images of objects of a category that its model was not trained on."""
    return tuple(sorted((_ASSETS / "samples" / category).glob("*.png")))


def load_model(name: str, device: str = "cpu") -> Model:
    """Load a model by its shipped name (``chairs``) or its path; ``.pth`` is a checkpoint of the authors' trainer.

    Args:
        device: "cpu" or "cuda", for the network; codes, cameras and images stay on the processor.

    Raises ``ValueError`` if there is no such model or no such device.
    """
    model = _read(name)
    model.field.to(require_device(device))
    return model


def _read(name: str) -> Model:
    if name in shipped_models():
        return Model.load(SHIPPED / f"{name}.safetensors")
    path = Path(name)
    if path.suffix.lower() in (".pth", ".pt"):
        return load_authors(path)
    if path.suffix or path.exists():
        return Model.load(path)
    have = ", ".join(shipped_models()) or "none"
    raise ValueError(f"no model called {name!r} (shipped: {have}); give one of these or the path of a model file")
