"""All that a session makes, as a value: to be kept, or saved as a project."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from core.models.model import Instance
from core.models.open_models import OpenModels
from viewer.values.fit_history import FitHistory, FitRequest
from viewer.values.history import History
from viewer.values.objects import EditableObject
from viewer.values.state import State

SUFFIX = ".codenerf"


@dataclass(frozen=True, eq=False)
class Project:
    """Everything needed to resume a session."""

    history: History
    objects: tuple[EditableObject, ...] = ()  # added objects, also removed ones, the oldest first
    fits: Mapping[str, FitHistory] = field(default_factory=dict)  # how objects were fitted, by their keys
    pending: tuple[FitRequest, ...] = ()  # the running fit and the waiting ones
    model_files: Mapping[str, str] = field(default_factory=dict)  # names and paths of models, by fingerprint
    path: Path | None = None  # file that a person saved it to
    others: frozenset[str] = frozenset()  # keys of objects made before: the project's if its history has them
    lost: tuple[str, ...] = ()  # reasons why parts of a file could not be read

    @cached_property
    def members(self) -> tuple[EditableObject, ...]:
        """The objects that were made in it or that its history has, with their versions."""
        names = frozenset[str]().union(*(state.mix.names | state.removed for state, _ in self.history.steps.values()))
        members = (item for item in self.objects if item.name in names or item.key not in self.others)
        roots = {item.version_of or item.key for item in members}
        return tuple(item for item in self.objects if (item.version_of or item.key) in roots)

    @property
    def is_empty(self) -> bool:
        """True if nothing was made, edited or begun."""
        return not (len(self.history.steps) > 1 or self.pending or self.members)

    def adopted(self, models: OpenModels, folder: Path | None = None) -> "Project":
        """Return the project with objects of the models that are there: in its file's folder by name, or by path."""
        for fingerprint, name in self.model_files.items():
            neighbour = folder and folder / Path(name).name
            models.expect(fingerprint, str(neighbour) if neighbour and neighbour.is_file() else name)
        return self._converted(models.adopt)

    def _converted(self, change: Callable[[Instance], Instance]) -> "Project":
        def state_converted(state: State) -> State:
            scene = replace(state.scene, instance=change(state.scene.instance))
            return replace(state, scene=scene)

        pending = (request._replace(history=request.history.converted(change)) for request in self.pending)
        return replace(
            self,
            history=self.history.everywhere(state_converted),
            objects=tuple(item.converted(change) for item in self.objects),
            fits={key: fit.converted(change) for key, fit in self.fits.items()},
            pending=tuple(pending),
        )
