"""The editor of an object's codes and its camera, with undo."""

from collections.abc import Callable
from dataclasses import replace
from itertools import takewhile

import torch

from core.geometry.camera import Camera
from core.models.codes import CODE_KINDS, CodeKind
from core.models.model import Instance, Model
from core.models.open_models import OpenModels
from core.models.photo_detail import PhotoDetail
from core.models.scene import Scene
from viewer.services.signal import Signal
from viewer.values import orbit
from viewer.values.history import History
from viewer.values.objects import EditableObject, ObjectLibrary
from viewer.values.project import Project
from viewer.values.restoring import first_mix, reopened, restored
from viewer.values.state import Mix, Pair, State


class Editor:
    """Edits one object of any open model. An edit is one step of undo.

    Edits with the same ``gesture``, the name of a drag, are one step until :meth:`end_gesture`. Only objects of one
    model can be mixed.
    """

    def __init__(self, models: OpenModels, first: Model, generator: torch.Generator) -> None:
        """Show the first object of the model ``first``; ``generator`` is the source of random samples."""
        self.models = models
        self.objects = ObjectLibrary(models)
        mix = first_mix(self.objects, first)
        scene = Scene(self.objects[mix.a.shape].instance, orbit.home(first))
        self.history = History.of(State(scene, mix, is_a=True))
        self.scene_changed = Signal()  # emitted after every change of the scene, also by undo
        self.object_chosen = Signal()  # emitted afterwards if a person chose an object
        self.resized = Signal()  # emitted afterwards if a person stretched the object
        self._generator = generator

    # State

    @property
    def state(self) -> State:
        """The current state, all of which undo restores."""
        return self.history.now

    @property
    def scene(self) -> Scene:
        """The scene on screen."""
        return self.state.scene

    @property
    def model(self) -> Model:
        """The model of the object on screen."""
        return self.scene.instance.model

    def is_mixable(self, name: str) -> bool:
        """Return whether an object is of the same model as the one on screen, so that they can be mixed."""
        return self.objects[name].instance.fingerprint == self.scene.instance.fingerprint

    @property
    def original(self) -> Instance:
        """A without edits: as trained, fitted or opened."""
        shape, texture = self.state.mix.a
        return self.objects[texture].original.taking("shape", self.objects[shape].original)

    @property
    def unmixed(self) -> Instance:
        """A, with its edits, as last shown without any of B; as left if never shown."""
        shape, texture = self.state.mix.a
        instance = self.objects[texture].instance.taking("shape", self.objects[shape].instance)
        for kind in CODE_KINDS:
            instance = instance.taking(kind, self._last_unmixed(kind) or instance)
        return instance

    def _last_unmixed(self, kind: CodeKind) -> Instance | None:
        name = getattr(self.state.mix.a, kind)

        def is_of_a(state: State) -> bool:
            return getattr(state.mix.a, kind) == name and state.scene.instance.fingerprint == self.model.fingerprint

        of_a = takewhile(is_of_a, (self.state, *reversed(self.history.past)))
        return next((state.scene.instance for state in of_a if not getattr(state.mix, kind)), None)

    @property
    def mix_ends(self) -> tuple[Instance, Instance]:
        """A and B, between which the mix pad mixes: A with its edits."""
        return self.unmixed, self.objects[self.state.mix.b].instance

    @property
    def film_partner(self) -> Instance | None:
        """B; None if B cannot be mixed with the object on screen or looks like it."""
        name = self.state.mix.b
        if name not in self.objects or self.objects.is_missing(name) or not self.is_mixable(name):
            return None
        partner = self.objects[name].instance
        return None if partner.with_detail(None) == self.scene.instance.with_detail(None) else partner

    # The camera

    def set_camera(self, camera: Camera, gesture: str = "") -> None:
        """Change the camera. Consecutive drags, such as turning and zooming, are one step."""
        scene = replace(self.scene, camera=camera)
        self._go(self.history.changed(replace(self.state, scene=scene), gesture, moves=bool(gesture)))

    # Codes

    def set_detail(self, detail: PhotoDetail, gesture: str = "") -> None:
        """Replace the object's photo detail."""
        self._edit(self.scene.instance.changed(detail=detail), gesture=gesture)

    def reset(self) -> None:
        """Return to object A without its edits and without any of B; its edits are a version."""
        self.objects.keep(self.state.version_of, self.scene.instance)
        self._edit(self.original, replace(self.state.mix, shape=0.0, texture=0.0), is_a=True)

    def sample(self) -> None:
        """Sample shape and texture from the distribution of the trained codes."""
        self._edit(self.model.sample(self._generator), is_a=False)

    def edit(self, edited: Instance, gesture: str = "") -> None:
        """Replace the object by an edited one.

        The camera keeps the view's scale, so that sides that are not stretched stay where they are.
        """
        camera = self.scene.camera
        is_resized = edited.codes.factors != self.scene.instance.codes.factors
        if is_resized:
            distance = camera.distance * self.scene.instance.codes.scale / edited.codes.scale
            camera = orbit.at_distance(camera, distance, self.model)
        self._edit(edited, gesture=gesture, camera=camera)
        if is_resized:
            self.resized.emit()

    # Objects A and B

    def show_object(self, name: str) -> None:
        """Make an object A, without any of B; nothing happens while its model is missing.

        A fitted object is seen from its photo's camera at first and after an object of another model.
        """
        if self.objects.is_missing(name):
            return
        self.end_gesture()  # the object itself may be on screen
        if self.state.mixed_from:
            self.objects.keep(self.state.mixed_from, self.scene.instance)
        instance = self.objects[name].instance
        camera = self.scene.camera
        was_a = any(state.mix.a == (name, name) for state in (self.state, *self.history.past))
        if instance.detail and not (was_a and self.is_mixable(name)):
            camera = orbit.photo_camera(instance.detail.views[0].camera, instance.model)
        self._edit(instance, self._mix_from(name), camera=camera, is_a=True)
        self.object_chosen.emit()

    def last_version(self, name: str) -> str:
        """Return the version of an object that was shown last; its first one if none was."""
        versions = self.objects.versions(name)
        return next((version for version in self.history.newest if version in versions), name)

    def unlist(self, removed: frozenset[str]) -> None:
        """Remove these added objects, and no others, from all lists, even if one is on screen."""
        self._go(self.history.changed(replace(self.state, removed=removed)))

    def set_b(self, name: str) -> None:
        """Make an object B; codes with an amount of B are mixed again."""
        mix = replace(self.state.mix, b=self.objects[name].name)
        self._mix(mix, tuple(kind for kind in CODE_KINDS if getattr(mix, kind) > 0))

    def mix_both(self, shape: float, texture: float, gesture: str = "") -> None:
        """Mix shape and texture, each from A (0) to B (1)."""
        self._mix(replace(self.state.mix, shape=shape, texture=texture), CODE_KINDS, gesture)

    # The scene

    def add_and_show(self, added: EditableObject, camera: Camera) -> str:
        """Add an object to the library, make it A, seen from a camera, and return its name."""
        name = self.objects.add(added)
        self.show_added(name, camera)
        return name

    def show_added(self, name: str, camera: Camera) -> None:
        """Make an object A as fitted or opened, seen from a camera."""
        self._edit(self.objects[name].original, self._mix_from(name), camera=camera, is_a=True)

    def join(self, scene: Scene) -> None:
        """Change the scene as part of the last edit."""
        if scene != self.scene:
            self._go(self.history.joined(replace(self.state, scene=scene)))

    def improve(self, name: str, better: EditableObject, camera: Camera) -> bool:
        """Give an added object the codes of a better fit; show them if the old ones are on screen, unedited.

        Returns whether the old ones were on screen.
        """
        original = self.objects[name].original
        self.objects.refit(name, better)
        on_screen = self.scene.instance == original
        if on_screen and better.instance != original:
            self.show_added(name, camera)
        return on_screen

    def rename(self, name: str, to: str) -> str:
        """Rename an added object, also in undo; return its new name, made unique."""
        if to in ("", name):
            return name
        new = self.objects.rename(name, to)
        self.history = self.history.renamed({name: new})
        return new

    def restore(self, saved: Project) -> dict[str, str]:
        """Add a project's objects and take its undo history in place of this one; return keys here by keys given.

        Its edits of an object replace those made here, which become a version. The current state is the nearest that
        can be shown; this one, after the others, if there is none.
        """
        history, keys = restored(saved, self.state, self.objects, self.models)
        self._go(history)
        return keys

    # Models that are missing

    def add_model(self, model: Model) -> None:
        """Add the objects of a newly opened model; objects and states that waited for it can be shown."""
        self.objects.add_model(model)
        self.objects.convert(self.models.adopt)
        self.history = reopened(self.history, model, self.objects, self.models)

    # Undo

    def end_gesture(self) -> None:
        """End the drag: the next edit is another step."""
        if self.history.gesture:
            self._go(self.history.without_gesture())

    def cancel_gesture(self) -> None:
        """End the drag as if it had not begun."""
        previous = self.scene
        self.history = self.history.cancelled()
        if self.scene != previous:
            self.scene_changed.emit()

    def undo(self) -> None:
        """Undo a step, if any; states that cannot be shown are skipped."""
        self._go(self._nearest(History.undone))

    def redo(self) -> None:
        """Redo a step, if any; states that cannot be shown are skipped."""
        self._go(self._nearest(History.redone))

    def _nearest(self, step: Callable[[History], History]) -> History:
        """Return the history after steps to the next state that can be shown; the same one if there is none."""
        previous = self.history
        history = step(self.history)
        while not self.objects.can_show(history.now) and history.current != previous.current:
            previous = history
            history = step(history)
        return history if self.objects.can_show(history.now) else self.history

    def go_to(self, number: int) -> None:
        """Go to a step of undo, perhaps of another branch, by its number.

        Nothing happens if it cannot be shown.
        """
        history = self.history.at(number)
        if self.objects.can_show(history.now):
            self._go(history)

    def show_state(self, state: State) -> None:
        """Go to a state of undo that had to wait for its model."""
        scene = replace(state.scene, instance=self.models.adopt(state.scene.instance))
        numbers = (number for number, step in self.history.steps.items() if step.state.scene == scene)
        if (number := next(numbers, None)) is not None:
            self.go_to(number)

    def _mix_from(self, name: str) -> Mix:
        """Return the mix of an object without anything of B: the last B of its model, else its second object."""
        model = self.objects[name].instance.model
        states = (self.state, *reversed(self.history.past))
        here = (state for state in states if state.scene.instance.fingerprint == model.fingerprint)
        mixes = (state.mix for state in here if self.objects.can_show(state))
        return Mix(Pair(name, name), (next(mixes, None) or first_mix(self.objects, model)).b)

    def _mix(self, mix: Mix, kinds: tuple[CodeKind, ...], gesture: str = "") -> None:
        mixed = self.unmixed.mixed(self.objects[mix.b].instance, mix.shape, mix.texture)
        instance = self.scene.instance
        for kind in kinds:
            instance = instance.taking(kind, mixed)
        self._edit(instance, mix, gesture)

    def _edit(
        self,
        instance: Instance,
        mix: Mix | None = None,
        gesture: str = "",
        camera: Camera | None = None,
        is_a: bool | None = None,
    ) -> None:
        """Add a step of undo: the object, and the mix, camera and :attr:`State.is_a` that are given."""
        scene = Scene(instance, camera or self.scene.camera)
        is_a = self.state.is_a if is_a is None else is_a
        self._go(self.history.changed(replace(self.state, scene=scene, mix=mix or self.state.mix, is_a=is_a), gesture))

    def _go(self, history: History) -> None:
        """Take another history; after a drag, the object on screen keeps its edits, even if another one follows."""
        previous = self.scene
        if self.history.gesture and not history.gesture:
            self.objects.leave(self.state.version_of, previous.instance)
        for name, instance in self.history.left_by(history).items():
            self.objects.keep(name, instance)
        self.history = history
        self.objects.removed = history.now.removed
        if not history.gesture:
            self.objects.leave(history.now.version_of, history.now.scene.instance)
        if history.now.scene != previous:
            self.scene_changed.emit()
