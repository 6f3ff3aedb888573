"""The available models: shipped ones by name, others by path; and sample images to try them with."""

from functools import cache
from pathlib import Path

from core.models.authors_checkpoint import load_authors
from core.models.model import Model
from core.runtime.precision import require_device

_ASSETS = Path(__file__).resolve().parents[2] / "assets"
SHIPPED = _ASSETS / "models"
FORMER = SHIPPED / "former"  # models shipped before, by fingerprint: what was made with them still opens
DEFAULT_MODEL = "chairs"


def shipped_models() -> tuple[str, ...]:
    """Return the names of the models that come with the program."""
    return tuple(sorted(path.stem for path in SHIPPED.glob("*.safetensors")))


def former_model(fingerprint: str) -> str | None:
    """Return the name of the formerly shipped model that codes of a fingerprint belong to, if any."""
    names = sorted(path.stem for path in FORMER.glob("*.safetensors"))
    return next((name for name in names if name == fingerprint or _read(name).shares_codes_with(fingerprint)), None)


@cache
def sample_images(category: str) -> tuple[Path, ...]:
    """Return images of objects of a category that its model was not trained on."""
    return tuple(sorted((_ASSETS / "samples" / category).glob("*.png")))


def load_model(name: str, device: str = "cpu") -> Model:
    """Load a model by its shipped name (``chairs``), the fingerprint of a formerly shipped one, or a path.

    A ``.pth`` file is a checkpoint of the authors' trainer.

    Args:
        device: "cpu" or "cuda", for the network; codes, cameras and images stay on the processor.

    Raises ``ValueError`` if there is no such model or no such device.
    """
    model = _read(name)
    model.field.to(require_device(device))
    return model


def _read(name: str) -> Model:
    for folder in (SHIPPED, FORMER):
        if name in {path.stem for path in folder.glob("*.safetensors")}:
            return Model.load(folder / f"{name}.safetensors")
    path = Path(name)
    if path.suffix.lower() in (".pth", ".pt"):
        return load_authors(path)
    if path.suffix or path.exists():
        return Model.load(path)
    have = ", ".join(shipped_models()) or "none"
    raise ValueError(f"no model called {name!r} (shipped: {have}); give one of these or the path of a model file")
