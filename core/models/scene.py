"""A scene is what a person edits: which model, which codes, from where. Saved as JSON, exact to float32."""

import json
from dataclasses import dataclass
from pathlib import Path

import torch

from core.files import atomic_file
from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.model import Model


@dataclass(frozen=True)
class Scene:
    """One state of the editor. Edits make a new one."""

    model: str
    """the fingerprint of the model whose codes these are"""
    codes: Codes
    camera: Camera

    def save(self, path: Path) -> None:
        """Write the scene as JSON, whole or not at all. Raises ``ValueError`` for a path that cannot be written."""
        with atomic_file(path) as partial:
            partial.write_text(self.to_json() + "\n")

    def to_json(self) -> str:
        """The scene as JSON text."""
        camera = {name: getattr(self.camera, name) for name in Camera.__dataclass_fields__}
        about = {
            "model": self.model,
            "camera": camera,
            "shape": self.codes.shape.tolist(),
            "texture": self.codes.texture.tolist(),
        }
        return json.dumps(about, indent=1)

    @classmethod
    def load(cls, path: Path, model: Model) -> "Scene":
        """Read a scene for a model. Raises ``ValueError`` where it is none, or one of another model."""
        try:
            return cls.from_json(path.read_text(), model)
        except OSError as error:
            raise ValueError(f"cannot read the scene {path}: {error.strerror or error}") from None
        except UnicodeDecodeError:
            raise ValueError(f"{path} is not a scene file") from None
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None

    @classmethod
    def from_json(cls, text: str, model: Model) -> "Scene":
        """Read JSON text. Raises ``ValueError`` where it is no scene, or one of another model."""
        try:
            about = json.loads(text)
            found = about["model"]
            camera = Camera(**about["camera"])
            codes = Codes(torch.tensor(about["shape"]).float(), torch.tensor(about["texture"]).float())
        except (json.JSONDecodeError, KeyError, TypeError, RuntimeError) as error:
            raise ValueError(f"not a scene file ({type(error).__name__}: {error})") from None
        config = model.field.config
        sizes = (config.shape_latent,), (config.texture_latent,)
        if found != model.fingerprint or (codes.shape.shape, codes.texture.shape) != sizes:
            raise ValueError(
                f"the scene belongs to another model than this one of {model.category or 'unnamed things'}"
            )
        return cls(found, codes, camera)
