"""All that a person made with a model, as values that can be written down, and how they become JSON and back."""

import base64
import json
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import torch

from core.export.keyframes import Keyframe, Timeline, View
from core.fitting.fit import Hypothesis
from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.model import Model
from core.models.scene import Scene
from viewer.values.encoding import Parts, decode, decode_photo, encode
from viewer.values.fit_history import FitHistory, FitRequest
from viewer.values.history import History, Mix, Pair, State
from viewer.values.objects import EditableObject, ObjectLibrary

UNREADABLE = KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError, RecursionError
"""What reading raises where text is no session."""


class SavedTile(NamedTuple):
    """A candidate of a fit, without its thumbnail."""

    number: int
    hypothesis: Hypothesis
    eliminated_at: float | None


@dataclass(frozen=True, eq=False)
class SavedSession:
    """A session of one model, which :meth:`check` tells whether it can be continued with."""

    model: str
    """the name by which it was opened"""
    history: History
    objects: tuple[EditableObject, ...] = ()
    """those that are not the model's own, the oldest first"""
    removed: tuple[str, ...] = ()
    """those of them that are in no list any more"""
    grid: tuple[str, ...] = ()
    """objects in the grid"""
    fit: FitHistory = field(default_factory=FitHistory)
    """the last one that is over"""
    tiles: tuple[SavedTile, ...] = ()
    """its candidates"""
    pending: tuple[FitRequest, ...] = ()
    """the fit under way, and those that wait"""

    def check(self, model: Model) -> None:
        """Raise ``ValueError`` where it belongs to another model, or mixes objects that nobody has."""
        config = model.field.config
        sizes = (config.shape_latent,), (config.texture_latent,)
        keys = [key.view.codes for state in self.history.states for key in state.timeline.keys]
        steps = [one.step for state in self.history.states for one in state.directions]
        objects = [one.codes for one in self.objects]
        codes = [*(state.scene.codes for state in self.history.states), *objects, *keys, *steps]
        made_here = all(model.shares_codes_with(state.scene.model) for state in self.history.states)
        if not made_here or any((one.shape.shape, one.texture.shape) != sizes for one in codes):
            raise ValueError(f"it was made with another model than this one of {model.category or 'unnamed things'}")
        known = {*ObjectLibrary(model).names, *(one.name for one in self.objects)}
        if any(not state.mix.names <= known for state in self.history.states):
            raise ValueError("it mixes objects that are not here")

    def encoded(self, parts: Parts) -> Any:
        """As JSON; what it refers to joins the parts."""
        return encode(replace(self, fit=_without_renders(self.fit), pending=tuple(map(_request, self.pending))), parts)

    @classmethod
    def decoded(cls, about: Any, parts: Parts) -> "SavedSession":
        """What :meth:`encoded` was made of. Raises one of :data:`UNREADABLE`."""
        return decode(cls, about, parts)

    @classmethod
    def from_older(cls, text: str) -> "SavedSession":
        """What versions before projects wrote, as JSON alone. Raises ``ValueError`` where it is no session."""
        try:
            about = json.loads(text)
            return _from_older(about, str(about["opened"] if "opened" in about else about["model"]))
        except UNREADABLE as error:
            raise ValueError(f"not a whole session ({error})") from None


def _without_renders(fit: FitHistory) -> FitHistory:
    """Renders are made again. Of each step but the last, the leading hypothesis is enough to resume from."""
    steps = tuple(replace(step, hypotheses=step.hypotheses[:1]) for step in fit.steps[:-1])
    return replace(fit, steps=(*steps, *fit.steps[-1:]), frame=None, difference=None)


def _request(request: FitRequest) -> FitRequest:
    return request._replace(history=_without_renders(request.history))


def _from_older(about: dict, model: str) -> SavedSession:
    mix, timeline = about["mix"], dict(about["timeline"])
    keys = tuple(Keyframe(float(seconds), _view(found)) for seconds, found in timeline.pop("keys"))
    objects = tuple(
        EditableObject(one["name"], _view(one["scene"]).codes, one["photo"] and _photo(one["photo"]))
        for one in (about["things"] if "things" in about else about["objects"])
    )
    scene = Scene(about["scene"]["model"], *_view(about["scene"]))
    mixed = Mix(Pair(*mix["a"]), mix["b"], float(mix["shape"]), float(mix["texture"]))
    return SavedSession(model, History(State(scene, mixed, Timeline(keys, **timeline))), objects)


def _view(about: dict) -> View:
    codes = Codes(torch.tensor(about["shape"]).float(), torch.tensor(about["texture"]).float())
    return View(codes, Camera(**about["camera"]))


def _photo(text: str) -> Any:
    return decode_photo(base64.b64decode(text))
