"""The available models: shipped ones by name, others by path; and sample images to try them with."""

from functools import cache
from pathlib import Path

from core.models.authors_checkpoint import load_authors
from core.models.model import Model
from core.runtime.precision import require_device

_ASSETS = Path(__file__).resolve().parents[2] / "assets"
SHIPPED = _ASSETS / "models"
FORMER = SHIPPED / "former"  # models of earlier versions, named by fingerprint: their scenes still open
DEFAULT_MODEL = "chairs"


def shipped_models() -> tuple[str, ...]:
    """Return the names of the shipped models, in alphabetical order."""
    return tuple(sorted(path.stem for path in SHIPPED.glob("*.safetensors")))


def former_model(fingerprint: str) -> str | None:
    """Return the name of a formerly shipped model that is, or extends, the model with a fingerprint."""
    names = sorted(path.stem for path in FORMER.glob("*.safetensors"))
    return next((name for name in names if name == fingerprint or _read(name).shares_codes_with(fingerprint)), None)


@cache
def sample_images(category: str) -> tuple[Path, ...]:
    """Return images of held-out objects of a category ("cars"); empty for a category without samples."""
    return tuple(sorted((_ASSETS / "samples" / category).glob("*.png")))


def load_model(name: str, device: str = "cpu") -> Model:
    """Load a model by name, fingerprint or path.

    Names are those of shipped models (``chairs``), fingerprints those of formerly shipped ones. A ``.pth`` or ``.pt``
    file is a checkpoint of the authors' trainer.

    Args:
        device: "cpu" or "cuda", for the network; codes, cameras and images stay on the processor.

    Raises ``ValueError`` if there is no such model or no such device.
    """
    model = _read(name)
    model.field.to(require_device(device))
    if _shipped_path(name):
        object.__setattr__(model, "origin", (_opened, (name, model.fingerprint, device)))
    return model


@cache  # one model for all objects that are unpickled
def _opened(name: str, fingerprint: str, device: str) -> Model:
    """Load the shipped model of pickled objects. Raises ``ValueError`` if it has changed since."""
    model = load_model(name, device)
    if model.fingerprint != fingerprint:
        raise ValueError(f"the object was pickled by another version, whose model {name!r} differs from this one")
    return model


def _shipped_path(name: str) -> Path | None:
    paths = [path for folder in (SHIPPED, FORMER) for path in folder.glob("*.safetensors")]
    return next((path for path in paths if path.stem == name), None)


def _read(name: str) -> Model:
    if shipped := _shipped_path(name):
        return Model.load(shipped)
    path = Path(name)
    if path.suffix.lower() in (".pth", ".pt"):
        return load_authors(path)
    if path.suffix or path.exists():
        return Model.load(path)
    have = ", ".join(shipped_models()) or "none"
    raise ValueError(f"no model called {name!r} (shipped: {have}); give one of these or the path of a model file")
