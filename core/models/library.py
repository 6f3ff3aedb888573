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
    """Return the names of the shipped models, in alphabetical order."""
    return tuple(sorted(path.stem for path in SHIPPED.glob("*.safetensors")))


def model_with(fingerprint: str | None, preferred: str) -> str:
    """Return the name of the shipped model with a fingerprint; the preferred name if that fits, or none does."""
    if fingerprint is None or load_model(preferred).shares_codes_with(fingerprint):
        return preferred
    names = (name for name in shipped_models() if load_model(name).shares_codes_with(fingerprint))
    return next(names, preferred)


@cache
def sample_images(category: str) -> tuple[Path, ...]:
    """Return images of held-out objects of a category ("cars"); empty for a category without samples."""
    return tuple(sorted((_ASSETS / "samples" / category).glob("*.png")))


def load_model(name: str, device: str = "cpu") -> Model:
    """Load a shipped model by its name (``chairs``), or another one by its path.

    A ``.pth`` or ``.pt`` file is a checkpoint of the authors' trainer.

    Args:
        device: "cpu" or "cuda", for the network; codes, cameras and images stay on the processor.

    Raises ``ValueError`` if there is no such model or no such device.
    """
    model = _read(name)
    model.field.to(require_device(device))
    if name in shipped_models():
        object.__setattr__(model, "origin", (_opened, (name, model.fingerprint, device)))
    return model


@cache  # one model for all objects that are unpickled
def _opened(name: str, fingerprint: str, device: str) -> Model:
    """Load the shipped model of pickled objects. Raises ``ValueError`` if it has changed since."""
    model = load_model(name, device)
    if model.fingerprint != fingerprint:
        raise ValueError(f"the object was pickled by another version, whose model {name!r} differs from this one")
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
