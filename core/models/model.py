"""A trained category model: the field, its code book and the scene it was trained in; one safetensors file."""

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from core.geometry.camera import Camera
from core.models.ablations import field_of
from core.models.codes import CodeBook, Entry
from core.models.field import Field
from core.models.field_config import FieldConfig
from core.models.viewpoint import ViewpointClassifier

FORMAT = "codenerf-1"


@dataclass(frozen=True, eq=False)
class Model:
    """What rendering and fitting need to know of a category. Neither ever changes it."""

    field: Field
    codes: CodeBook
    extent: tuple[float, float, float]
    """Half the size of the box that holds every training object, along x, y, z (scene units)."""
    category: str
    image_size: int
    """px, the size of the training pictures"""
    focal: float
    """px at ``image_size``"""
    distance: float
    """scene units, from which the training pictures were taken"""
    painted_ground: bool = False
    """The network itself paints the white ground (the authors' checkpoints): light never passes the last sample."""
    glance: ViewpointClassifier | None = None
    """tells from where a picture is probably taken; on the processor"""

    def __post_init__(self) -> None:
        self.field.requires_grad_(False).eval()
        if self.glance:
            self.glance.requires_grad_(False).eval()

    @property
    def device(self) -> torch.device:
        """Where the field lives."""
        return self.field.density_layer.weight.device

    @cached_property
    def extent_tensor(self) -> Tensor:
        """``extent`` on the model's device."""
        return torch.tensor(self.extent, device=self.device)

    @property
    def corner(self) -> float:
        """px, by how much its rays pass left of and above pixel centres: the authors' go through pixel corners."""
        return 0.5 if self.painted_ground else 0.0

    @property
    def entangled(self) -> bool:
        """One of the designs of :mod:`core.models.ablations`, drawn exactly only."""
        return self.field.config.design != "codenerf"

    @cached_property
    def fingerprint(self) -> str:
        """A hash of the field's weights and the codes, by which a scene recognises its model."""
        digest = hashlib.sha256()
        for name, tensor in sorted(_drawing(self).items()):
            digest.update(name.encode())
            digest.update(tensor.numpy().tobytes())
        return digest.hexdigest()[:16]

    def camera(self, azimuth: float, elevation: float, distance: float | None = None) -> Camera:
        """A camera (rad, rad, scene units) at the training pictures' size, focal length and, unless given, distance."""
        size = self.image_size
        return Camera(azimuth, elevation, distance or self.distance, self.focal, size, size)

    def save(self, path: Path) -> None:
        """Write weights, codes and configuration as one safetensors file; an interrupted write leaves no file."""
        about = {
            "config": asdict(self.field.config),
            "objects": [list(entry) for entry in self.codes.objects],
            "broken": sorted(self.codes.broken),
            "extent": list(self.extent),
            "category": self.category,
            "image_size": self.image_size,
            "focal": self.focal,
            "distance": self.distance,
            "painted_ground": self.painted_ground,
        }
        partial = path.with_name(path.name + ".partial")
        save_file(_tensors(self), partial, metadata={"format": FORMAT, "model": json.dumps(about)})
        partial.replace(path)

    @classmethod
    def load(cls, path: Path) -> "Model":
        """Read a model file. Raises ``ValueError`` naming the file where it is none."""
        try:
            with safe_open(path, framework="pt") as file:
                about = (file.metadata() or {}).get("model")
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except FileNotFoundError:
            raise ValueError(f"no such model file: {path}") from None
        except (SafetensorError, OSError) as error:
            raise ValueError(f"{path} is not a model file: {error}") from None
        if about is None:
            raise ValueError(f"{path} is not a model file of this program")
        try:
            return cls._from_parts(json.loads(about), tensors)
        except (KeyError, TypeError, RuntimeError, ValueError) as error:
            raise ValueError(f"{path} does not hold a whole model: {error}") from None

    @classmethod
    def _from_parts(cls, about: dict, tensors: dict[str, Tensor]) -> "Model":
        field = field_of(FieldConfig(**about["config"]))
        shapes, textures = tensors.pop("codes.shapes").float(), tensors.pop("codes.textures").float()
        glance = ViewpointClassifier() if any(name.startswith("glance.") for name in tensors) else None
        if glance:
            names = [name for name in tensors if name.startswith("glance.")]
            glance.load_state_dict({name.removeprefix("glance."): tensors.pop(name).float() for name in names})
        field.load_state_dict({name.removeprefix("field."): tensor.float() for name, tensor in tensors.items()})
        objects = tuple(Entry(*entry) for entry in about["objects"])
        codes = CodeBook(shapes, textures, objects, frozenset(about.get("broken", ())))
        about = {key: about[key] for key in ("category", "image_size", "focal", "distance", "painted_ground")} | {
            "extent": tuple(about["extent"])
        }
        return cls(field, codes, **about, glance=glance)


def _tensors(model: Model) -> dict[str, Tensor]:
    """All that is saved: what draws in single precision, what only guesses in half."""
    guessing = model.glance.state_dict() if model.glance else {}
    return _drawing(model) | {f"glance.{name}": tensor.half() for name, tensor in guessing.items()}


def _drawing(model: Model) -> dict[str, Tensor]:
    tensors = {f"field.{name}": tensor for name, tensor in model.field.state_dict().items()}
    tensors |= {"codes.shapes": model.codes.shapes, "codes.textures": model.codes.textures}
    return {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
