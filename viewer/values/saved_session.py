"""All that a person made with a model, as values that can be written down, and how they become JSON and back."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from core.fitting.fit import Hypothesis
from core.models.model import Model
from viewer.values.encoding import Parts, decode, encode
from viewer.values.fit_history import FitHistory, FitRequest
from viewer.values.history import History
from viewer.values.objects import EditableObject, ObjectLibrary


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
        pairs = [one for each in codes for one in (each, each.detail) if one]
        if not made_here or any((one.shape.shape, one.texture.shape) != sizes for one in pairs):
            raise ValueError(f"it was made with another model than this one of {model.category or 'unnamed things'}")
        known = {*ObjectLibrary(model).names, *(one.name for one in self.objects)}
        if any(not state.mix.names <= known for state in self.history.states):
            raise ValueError("it mixes objects that are not here")

    def moved(self, move: Callable[[Path], Path]) -> "SavedSession":
        """With other paths of the photos and poses that have been read."""
        pending = tuple(one._replace(history=_moved(one.history, move)) for one in self.pending)
        return replace(self, fit=_moved(self.fit, move), pending=pending)

    def encoded(self, parts: Parts) -> Any:
        """As JSON; what it refers to joins the parts."""
        return encode(replace(self, fit=_without_renders(self.fit), pending=tuple(map(_request, self.pending))), parts)

    @classmethod
    def decoded(cls, about: Any, parts: Parts) -> "SavedSession":
        """The session that :meth:`encoded` was made of. Raises ``ValueError`` where it is no session."""
        found: SavedSession = decode(cls, about, parts)
        for fit in (found.fit, *(request.history for request in found.pending)):
            _check_cameras(fit)
        return found


def _moved(fit: FitHistory, move: Callable[[Path], Path]) -> FitHistory:
    """Files that have not been read yet stay where they are."""
    read = [one._replace(path=move(one.path), pose=one.pose and move(one.pose)) for one in fit.sources]
    read = read[: len(fit.photos)]
    photos = tuple(replace(photo, source=source) for photo, source in zip(fit.photos, read, strict=True))
    return replace(fit, sources=(*read, *fit.sources[len(read) :]), photos=photos)


def _check_cameras(fit: FitHistory) -> None:
    """Raise ``ValueError`` where the cameras of a fit are not of its photos' sizes, at which they are rendered."""
    sizes = {fitted.pixels.shape[1::-1] for fitted in fit.photos}
    for step in fit.steps:
        for cameras in (step.cameras, *(one.cameras for one in (*step.hypotheses, step.runner_up) if one)):
            if not {(camera.width, camera.height) for camera in cameras} <= sizes:
                raise ValueError("the cameras have another size than the photos")


def _without_renders(fit: FitHistory) -> FitHistory:
    """Renders are made again. Of each step but the last, the leading hypothesis is enough to resume from."""
    steps = tuple(replace(step, hypotheses=step.hypotheses[:1]) for step in fit.steps[:-1])
    return replace(fit, steps=(*steps, *fit.steps[-1:]), frame=None, difference=None)


def _request(request: FitRequest) -> FitRequest:
    return request._replace(history=_without_renders(request.history))
