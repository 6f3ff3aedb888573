"""All that a person made in a session, as text: the state, the timeline, and the objects fitted or opened."""

import base64
import io
import json
from dataclasses import asdict, dataclass

import numpy as np
import torch
from PIL import Image

from core.export.keyframes import Keyframe, Timeline, View
from core.models.model import Model
from core.models.scene import Scene
from core.photos.photo import Photo
from viewer.values.history import Mix, Pair, State
from viewer.values.objects import EditableObject


@dataclass(frozen=True)
class SavedSession:
    """A session as text. The name of its model is kept beside the rest, which can only be read for that model."""

    model: str
    """the name by which it was opened"""
    text: str
    """JSON"""

    @classmethod
    def of(cls, model: str, state: State, objects: tuple[EditableObject, ...]) -> "SavedSession":
        """Write a session down.

        Args:
            objects: those that are not the model's own, the oldest first.
        """
        scene, mix, timeline = state.scene, state.mix, state.timeline
        about = {
            "model": model,
            "scene": _to_dict(scene),
            "mix": asdict(mix),
            "timeline": {
                "keys": [(key.seconds, _to_dict(Scene(scene.model, *key.view))) for key in timeline.keys],
                **{name: getattr(timeline, name) for name in ("length", "loop", "turns", "smooth")},
            },
            "objects": [
                {"name": one.name, "scene": _to_dict(Scene(scene.model, one.codes, scene.camera))}
                | {"photo": one.photo and _encode_photo(one.photo)}
                for one in objects
            ],
        }
        return cls(model, json.dumps(about))

    @classmethod
    def read(cls, text: str) -> "SavedSession":
        """What :attr:`text` was, also where an older version wrote it. Raises ``ValueError`` where it is no session."""
        try:
            about = json.loads(text)
            return cls(str(about["opened"] if "opened" in about else about["model"]), text)
        except (ValueError, KeyError, TypeError):
            raise ValueError("not a saved session") from None

    def restored(self, model: Model) -> tuple[State, tuple[EditableObject, ...]]:
        """The state, and the added objects. Raises ``ValueError`` where they are not whole, or of another model."""
        about = json.loads(self.text)
        try:
            scene, mix, timeline = _scene(about["scene"], model), about["mix"], about["timeline"]
            keys = [Keyframe(float(seconds), _shot(_scene(found, model))) for seconds, found in timeline.pop("keys")]
            objects = tuple(
                EditableObject(one["name"], _scene(one["scene"], model).codes, one["photo"] and _decode(one["photo"]))
                for one in (about["things"] if "things" in about else about["objects"])
            )
            mixed = Mix(Pair(*mix["a"]), mix["b"], float(mix["shape"]), float(mix["texture"]))
            return State(scene, mixed, Timeline(tuple(keys), **timeline)), objects
        except (KeyError, TypeError, OSError, AttributeError) as error:
            raise ValueError(f"the saved session is not whole ({type(error).__name__}: {error})") from None


def _to_dict(scene: Scene) -> dict:
    return json.loads(scene.to_json())


def _scene(about: dict, model: Model) -> Scene:
    return Scene.from_json(json.dumps(about), model)


def _shot(scene: Scene) -> View:
    return View(scene.codes, scene.camera)


def _encode_photo(photo: Photo) -> str:
    """A photo as a PNG in base64, its mask as opacity."""
    pixels = (photo.pixels.clamp(0, 1) * 255 + 0.5).to(torch.uint8).numpy()
    file = io.BytesIO()
    Image.fromarray(np.dstack((pixels, 255 * photo.mask.numpy().astype(np.uint8)))).save(file, "PNG")
    return base64.b64encode(file.getvalue()).decode()


def _decode(text: str) -> Photo:
    with Image.open(io.BytesIO(base64.b64decode(text))) as image:
        rgba = torch.from_numpy(np.array(image.convert("RGBA")))
    return Photo(rgba[..., :3].float() / 255, rgba[..., 3] > 127)
