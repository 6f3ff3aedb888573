"""All that a person made in a session, as text: the state, the film, and the objects fitted or opened."""

import base64
import io
import json
from dataclasses import asdict, dataclass

import numpy as np
import torch
from PIL import Image

from core.export.keyframes import Key, Shot, Timeline
from core.models.model import Model
from core.models.scene import Scene
from core.photos.photo import Photo
from viewer.values.history import Mix, Pair, State
from viewer.values.objects import Thing


@dataclass(frozen=True)
class Saved:
    """A session put away. Which model it is of is told apart from the rest, which can only be read for that model."""

    model: str
    """the name by which it was opened"""
    text: str
    """JSON"""

    @classmethod
    def of(cls, model: str, state: State, things: tuple[Thing, ...]) -> "Saved":
        """Put a session away.

        Args:
            things: those that are not the model's own, the oldest first.
        """
        scene, mix, timeline = state.scene, state.mix, state.timeline
        about = {
            "opened": model,
            "scene": _told(scene),
            "mix": asdict(mix),
            "timeline": {
                "keys": [(key.seconds, _told(Scene(scene.model, *key.shot))) for key in timeline.keys],
                **{name: getattr(timeline, name) for name in ("length", "loop", "turns", "smooth")},
            },
            "things": [
                {"name": thing.name, "scene": _told(Scene(scene.model, thing.codes, scene.camera))}
                | {"photo": thing.photo and _packed(thing.photo)}
                for thing in things
            ],
        }
        return cls(model, json.dumps(about))

    @classmethod
    def read(cls, text: str) -> "Saved":
        """What :attr:`text` was. Raises ``ValueError`` where it is none of ours."""
        try:
            return cls(str(json.loads(text)["opened"]), text)
        except (ValueError, KeyError, TypeError):
            raise ValueError("not a saved session") from None

    def restored(self, model: Model) -> tuple[State, tuple[Thing, ...]]:
        """The state, and the added objects. Raises ``ValueError`` where they are not whole, or of another model."""
        about = json.loads(self.text)
        try:
            scene, mix, film = _scene(about["scene"], model), about["mix"], about["timeline"]
            keys = [Key(float(seconds), _shot(_scene(told, model))) for seconds, told in film.pop("keys")]
            things = tuple(
                Thing(one["name"], _scene(one["scene"], model).codes, one["photo"] and _unpacked(one["photo"]))
                for one in about["things"]
            )
            mixed = Mix(Pair(*mix["a"]), mix["b"], float(mix["shape"]), float(mix["texture"]))
            return State(scene, mixed, Timeline(tuple(keys), **film)), things
        except (KeyError, TypeError, OSError, AttributeError) as error:
            raise ValueError(f"the saved session is not whole ({type(error).__name__}: {error})") from None


def _told(scene: Scene) -> dict:
    return json.loads(scene.to_json())


def _scene(told: dict, model: Model) -> Scene:
    return Scene.from_json(json.dumps(told), model)


def _shot(scene: Scene) -> Shot:
    return Shot(scene.codes, scene.camera)


def _packed(photo: Photo) -> str:
    """A photo as a PNG in letters, its mask as opacity."""
    pixels = (photo.pixels.clamp(0, 1) * 255 + 0.5).to(torch.uint8).numpy()
    file = io.BytesIO()
    Image.fromarray(np.dstack((pixels, 255 * photo.mask.numpy().astype(np.uint8)))).save(file, "PNG")
    return base64.b64encode(file.getvalue()).decode()


def _unpacked(text: str) -> Photo:
    with Image.open(io.BytesIO(base64.b64decode(text))) as image:
        rgba = torch.from_numpy(np.array(image.convert("RGBA")))
    return Photo(rgba[..., :3].float() / 255, rgba[..., 3] > 127)
