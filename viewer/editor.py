"""The editor of an object's codes, its camera and the timeline, with undo."""

from collections.abc import Callable
from dataclasses import replace
from itertools import chain, takewhile

import torch
from torch import Tensor

from core.export.keyframes import Timeline
from core.geometry.camera import Camera
from core.models.codes import CODE_KINDS, CodeKind, Codes, CodeSpace
from core.models.model import Model
from core.models.open_models import OpenModels
from core.models.photo_detail import PhotoDetail
from core.models.scene import Scene
from viewer.services.signal import Signal
from viewer.values import orbit
from viewer.values.direction import Direction
from viewer.values.history import History, Mix, Pair, State
from viewer.values.objects import EditableObject, ObjectLibrary
from viewer.values.project import Project


class Editor:
    """Edits one object of any open model. An edit is one step of undo.

    Edits with the same ``gesture``, the name of a drag, are one step until :meth:`end_gesture`. Only objects of one
    model can be mixed.
    """

    def __init__(self, models: OpenModels, first: Model, generator: torch.Generator) -> None:
        """Show the first object of the model ``first``; ``generator`` is the source of random samples."""
        self.models, self.objects = models, ObjectLibrary(models)
        self._locked: frozenset[tuple[str, CodeKind]] = frozenset()
        mix = self._first_mix(first)
        scene = Scene(self.objects[mix.a.shape].codes, orbit.home(first))
        self.history = History.of(State(scene, mix, is_a=True))
        self.scene_changed = Signal[[]]()  # emitted after every change of the scene, also by undo
        self.object_chosen = Signal[[]]()  # emitted afterwards if a person chose an object
        self._generator = generator
        self._dragged = scene.codes  # before the newest drag along a direction

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
        return self.models.of(self.scene.codes)

    @property
    def locked(self) -> frozenset[CodeKind]:
        """The codes of this model's objects that edits leave unchanged."""
        return frozenset(kind for model, kind in self._locked if model == self.scene.codes.model)

    def is_mixable(self, name: str) -> bool:
        """Return whether an object is of the same model as the one on screen, so that they can be mixed."""
        return self.objects[name].codes.model == self.scene.codes.model

    def space(self, kind: CodeKind) -> CodeSpace:
        """Return the distribution of the trained codes of one kind."""
        codes = self.model.codes
        return codes.shape_space if kind == "shape" else codes.texture_space

    def code(self, kind: CodeKind) -> Tensor:
        """Return the current shape or texture code."""
        return getattr(self.scene.codes, kind)

    def pair(self, pair: Pair) -> Codes:
        """Return the codes of a pair as left: the shape of one object and the texture of another."""
        return self.objects[pair.texture].codes.taking("shape", self.objects[pair.shape].codes)

    @property
    def original(self) -> Codes:
        """The codes of A without edits: as trained, fitted or opened."""
        shape, texture = self.state.mix.a
        return self.objects[texture].original.taking("shape", self.objects[shape].original)

    @property
    def unmixed(self) -> Codes:
        """The codes of A, with its edits, as last shown without any of B; as left if never shown."""
        codes = self.pair(self.state.mix.a)
        for kind in CODE_KINDS:
            codes = codes.taking(kind, self._last_unmixed(kind) or codes)
        return codes

    def _last_unmixed(self, kind: CodeKind) -> Codes | None:
        now, states = self.state, chain([self.state], reversed(self.history.past))
        name, model = getattr(now.mix.a, kind), now.scene.codes.model
        of_a = takewhile(lambda one: getattr(one.mix.a, kind) == name and one.scene.codes.model == model, states)
        return next((state.scene.codes for state in of_a if not getattr(state.mix, kind)), None)

    @property
    def mix_ends(self) -> tuple[Codes, Codes]:
        """The codes of A and B between which the mix pad mixes: A with its edits, locked codes in both."""
        return self._keeping_locked(self.unmixed), self._keeping_locked(self.objects[self.state.mix.b].codes)

    @property
    def film_partner(self) -> Codes | None:
        """The codes of B, with locked ones; None if B cannot be mixed with the object on screen or looks like it."""
        name, codes = self.state.mix.b, self.scene.codes
        if name not in self.objects or self.is_missing(name) or not self.is_mixable(name):
            return None
        other = self._keeping_locked(self.objects[name].codes)
        return None if (other.shape_key, other.texture_key) == (codes.shape_key, codes.texture_key) else other

    def _keeping_locked(self, codes: Codes) -> Codes:
        """Return codes with the locked ones of the object on screen, if it is of the same model."""
        for kind in self.locked if codes.model == self.scene.codes.model else ():
            codes = codes.taking(kind, self.scene.codes)
        return codes

    # The camera

    def set_camera(self, camera: Camera, gesture: str = "") -> None:
        """Change the camera. Consecutive drags, such as turning and zooming, are one step."""
        scene = replace(self.scene, camera=camera)
        self._go(self.history.changed(replace(self.state, scene=scene), gesture, moves=bool(gesture)))

    # Codes

    def set_detail(self, detail: PhotoDetail, gesture: str = "") -> None:
        """Replace the object's photo detail."""
        codes = replace(self.scene.codes, detail=detail)
        self._edit(replace(self.scene, codes=codes), gesture=gesture)

    def set_texture(self, texture: Tensor, gesture: str = "") -> None:
        """Give the object another texture code."""
        self._set_codes(replace(self.scene.codes, texture=texture), self.state.mix, gesture)

    def reset(self) -> None:
        """Return to object A without its edits and without any of B, except locked parts."""
        self._set_codes(self.original, replace(self.state.mix, shape=0.0, texture=0.0), is_a=True)

    def sample(self) -> None:
        """Sample shape and texture from the distribution of the trained codes, except locked ones."""
        self._set_codes(self.model.codes.sample(self._generator), self.state.mix, is_a=False)

    # Along a direction

    def strength(self, direction: Direction) -> float:
        """Return the object's position along a direction, in standard deviations from the mean."""
        return direction.strength(self.scene.codes, self.model.codes.mean)

    def move_along(self, direction: Direction, to: float, gesture: str = "") -> None:
        """Move the object along a direction to a position in standard deviations from the mean.

        It ends at the direction's reach. All moves of a drag start from the same codes, so their errors do not add up.
        """
        if not gesture or gesture != self.history.gesture:
            self._dragged = self.scene.codes
        self._set_codes(direction.moved(self.model, self._dragged, to), self.state.mix, gesture)

    # Objects A and B

    def show_object(self, name: str) -> None:
        """Make an object A, without any of B, except locked parts; nothing happens while its model is missing.

        A fitted object is seen from its photo's camera at first and after an object of another model.
        """
        if self.is_missing(name):
            return
        self.end_gesture()  # the object itself may be on screen
        codes, pair, camera = self.objects[name].codes, Pair(name, name), self.scene.camera
        seen = any(state.mix.a == pair for state in (self.state, *self.history.past))
        if codes.detail and not (seen and self.is_mixable(name)):
            camera = orbit.photo_camera(codes.detail.views[0].camera, self.models.of(codes))
        self._set_codes(codes, self._mix_from(pair), camera=camera, is_a=True)
        self.object_chosen.emit()

    def show_unedited(self, name: str) -> None:
        """Show an object as it was left, so that undo comes back to its edits, then as fitted or opened."""
        self.show_object(name)
        self.reset()

    def duplicate(self, name: str) -> str:
        """Add a copy of an added object with its edits, show it, and return its name."""
        self.end_gesture()
        copy = self.objects.add(self.objects[name])
        self.show_object(copy)
        return copy

    def remove(self, name: str) -> None:
        """Remove an added object from all lists, even if it is on screen."""
        self._unlist(self.state.removed | {name})

    def put_back(self, name: str) -> None:
        """List a removed object again."""
        self._unlist(self.state.removed - {name})

    def _unlist(self, removed: frozenset[str]) -> None:
        self._go(self.history.changed(replace(self.state, removed=removed)))

    def take(self, kind: CodeKind, name: str) -> None:
        """Take the shape or the texture of an object for A, without any of B in that code."""
        mix = self.state.mix
        mix = replace(mix, a=mix.a._replace(**{kind: name})).with_amount(kind, 0.0)
        self._set_codes(self.scene.codes.taking(kind, self.objects[name].codes), mix)

    def set_b(self, name: str) -> None:
        """Make an object B; codes with an amount of B are mixed again."""
        mix = replace(self.state.mix, b=self.objects[name].name)
        self._mix(mix, tuple(kind for kind in CODE_KINDS if getattr(mix, kind) > 0))

    def mix_both(self, shape: float, texture: float, gesture: str = "") -> None:
        """Mix shape and texture, each from A (0) to B (1)."""
        self._mix(replace(self.state.mix, shape=shape, texture=texture), CODE_KINDS, gesture)

    # Scene and timeline

    def add_and_show(self, added: EditableObject, camera: Camera) -> str:
        """Add an object to the library, make it A, seen from a camera, and return its name."""
        name = self.objects.add(added)
        self.show_added(name, camera)
        return name

    def show_added(self, name: str, camera: Camera) -> None:
        """Make an object A as fitted or opened, seen from a camera; locks are ignored."""
        codes = self.objects[name].original
        self._edit(Scene(codes, camera), self._mix_from(Pair(name, name)), is_a=True)

    def show(self, codes: Codes, camera: Camera, gesture: str = "") -> None:
        """Show codes from a camera, such as those at a time of the timeline; locks are ignored."""
        codes = self._adopted(codes)
        is_a = self.state.is_a and codes == self.scene.codes
        self._edit(Scene(codes, camera), self._mix_of(self.models.of(codes)), gesture, is_a)

    def join(self, scene: Scene) -> None:
        """Change the scene as part of the last edit."""
        if scene != self.scene:
            self._go(self.history.joined(replace(self.state, scene=scene)))

    def improve(self, name: str, better: EditableObject, camera: Camera) -> bool:
        """Give an added object the codes of a better fit; show them if the old ones are on screen, unedited.

        Returns whether the old ones were on screen.

        Args:
            better: the object with the new codes.
            camera: camera to show the new codes from.
        """
        before = self.objects[name].original
        self.objects.refit(name, better)
        shown = self.scene.codes == before
        if shown and better.codes != before:
            self.show_added(name, camera)
        return shown

    def rename(self, name: str, to: str) -> str:
        """Rename an added object, also in undo; return its new name, made unique."""
        if to in ("", name):
            return name
        new = self.objects.rename(name, to)
        self.history = self.history.renamed({name: new})
        return new

    def set_timeline(self, timeline: Timeline, gesture: str = "") -> None:
        """Change the timeline; the view stays."""
        self._go(self.history.changed(replace(self.state, timeline=timeline), gesture))

    def restore(self, saved: Project) -> None:
        """Add a project's objects and take its undo history in place of this one.

        Its edits of an object replace those made here, which become a branch of the history. The current state is the
        nearest that can be shown; this one, after the others, if there is none.
        """
        names = self.objects.match(saved.objects)

        def with_names_here(state: State) -> State:
            removed = frozenset(names[name] for name in state.removed & names.keys())
            return replace(self._with_names_here(state, names), removed=removed)

        history = saved.history.everywhere(with_names_here)
        for one in saved.objects:
            here = self.objects[names[one.name]]
            if here.unedited and here.codes != one.codes:
                history = history.beside(self._as_left(here))
            if one.unedited:
                self.objects.leave(here.name, one.codes)
        shown = next((number for number in history.nearest if self.can_show(history.steps[number].state)), None)
        if shown is None:
            now = replace(self.state, removed=history.now.removed)
            self._go(History.of(now).after(history))
        else:
            self._go(history.at(shown))

    def _as_left(self, one: EditableObject) -> State:
        """Return a state that shows an object as left; it waits for the object's model if that is missing."""
        model = self.models.find(one.codes.model)
        camera = orbit.home(model) if model else self.scene.camera
        mix = Mix(Pair(one.name, one.name), self._first_mix(model).b if model else one.name)
        return State(Scene(one.codes, camera), mix, is_a=True)

    # Models that are missing

    def can_show(self, state: State) -> bool:
        """Return whether a state's model is open and its objects are here, all of that model."""
        model = state.scene.codes.model
        return self.models.can_show(state.scene.codes) and all(
            name in self.objects and self.objects[name].codes.model == model and not self.is_missing(name)
            for name in state.mix.names
        )

    def is_missing(self, name: str) -> bool:
        """Return whether an object cannot be shown because its model is missing."""
        return not all(map(self.models.can_show, self.objects[name].versions))

    @property
    def playable(self) -> Timeline:
        """The timeline without keyframes whose model is missing."""
        timeline = self.state.timeline
        keys = tuple(key for key in timeline.keys if self.models.can_show(key.view.codes))
        return timeline if len(keys) == len(timeline.keys) else replace(timeline, keys=keys)

    def add_model(self, model: Model) -> None:
        """Add the objects of a newly opened model; objects and states that waited for it can be shown."""
        self.objects.add_model(model)
        self.objects.convert(self._adopted)

        def with_names_here(state: State) -> State:
            waited = model.shares_codes_with(state.scene.codes.model)
            return self._with_names_here(state, {}) if waited else state

        self.history = self.history.everywhere(with_names_here)

    def _adopted(self, codes: Codes) -> Codes:
        """Return codes as those of the open model that extends theirs, if any."""
        model = self.models.find(codes.model)
        return model.adopt(codes) if model and model.fits(codes) else codes

    def _with_names_here(self, state: State, names: dict[str, str]) -> State:
        """Return a state with the names of its objects here: by ``names``, or those of its model's objects."""
        codes = self._adopted(state.scene.codes)
        own = {name: self.objects.name_here(name, codes.model) or name for name in state.mix.names - names.keys()}
        mix = state.mix.renamed(own | names)
        is_a, a = state.is_a, mix.a.shape
        if is_a is None and a in self.objects:  # of a former version
            is_a = codes == self.objects[a].original
        return replace(state, scene=replace(state.scene, codes=codes), mix=mix, is_a=is_a)

    # Undo

    def end_gesture(self) -> None:
        """End the drag: the next edit is another step."""
        if self.history.gesture:
            self._go(self.history.without_gesture())

    def undo(self) -> None:
        """Undo a step, if any; states that cannot be shown are skipped."""
        self._go(self._nearest(History.undone))

    def redo(self) -> None:
        """Redo a step, if any; states that cannot be shown are skipped."""
        self._go(self._nearest(History.redone))

    def _nearest(self, step: Callable[[History], History]) -> History:
        """Return the history after steps to the next state that can be shown; the same one if there is none."""
        before, history = self.history, step(self.history)
        while not self.can_show(history.now) and history.current != before.current:
            before, history = history, step(history)
        return history if self.can_show(history.now) else self.history

    def go_to(self, number: int) -> None:
        """Go to a step of undo, perhaps of another branch, by its index in :attr:`History.steps`.

        Nothing happens if it cannot be shown.
        """
        history = self.history.at(number)
        if self.can_show(history.now):
            self._go(history)

    def show_state(self, state: State) -> None:
        """Go to a state of undo that had to wait for its model."""
        scene = replace(state.scene, codes=self._adopted(state.scene.codes))
        scenes = [step.state.scene for step in self.history.steps]
        if scene in scenes:
            self.go_to(scenes.index(scene))

    # Not edits

    def lock(self, kind: CodeKind, locked: bool) -> None:
        """Lock one code of this model's objects against edits, or unlock it."""
        this = frozenset({(self.scene.codes.model, kind)})
        self._locked = self._locked | this if locked else self._locked - this

    def _mix_of(self, model: Model) -> Mix:
        """Return the last mix of a model's objects in undo, else a mix of its first two objects."""
        states = (self.state, *reversed(self.history.past))
        of_model = (one.mix for one in states if one.scene.codes.model == model.fingerprint and self.can_show(one))
        return next(of_model, None) or self._first_mix(model)

    def _first_mix(self, model: Model) -> Mix:
        forms = self.objects.families[model.fingerprint]
        first, second = ([*forms, *chain(*forms.values())] * 2)[:2]
        return Mix(Pair(first, first), second)

    def _mix_from(self, pair: Pair) -> Mix:
        """Return the mix of a pair with its model's last B, at amounts of 0."""
        return Mix(pair, self._mix_of(self.models.of(self.objects[pair.shape].codes)).b)

    def _mix(self, mix: Mix, kinds: tuple[CodeKind, ...], gesture: str = "") -> None:
        mixed = self.unmixed.mixed(self.objects[mix.b].codes, mix.shape, mix.texture)
        codes = self.scene.codes
        for kind in kinds:
            codes = codes.taking(kind, mixed)
        self._set_codes(codes, mix, gesture)

    def _set_codes(
        self, codes: Codes, mix: Mix, gesture: str = "", camera: Camera | None = None, is_a: bool | None = None
    ) -> None:
        """Edit codes and mix; locked codes stay, with their object A and amount of B."""
        now, codes = self.state, self._keeping_locked(codes)
        for kind in self.locked if codes.model == now.scene.codes.model else ():
            a = mix.a._replace(**{kind: getattr(now.mix.a, kind)})
            mix = replace(mix, a=a).with_amount(kind, getattr(now.mix, kind))
            is_a = is_a if now.is_a else False
        self._edit(Scene(codes, camera or now.scene.camera), mix, gesture, is_a)

    def _edit(self, scene: Scene, mix: Mix | None = None, gesture: str = "", is_a: bool | None = None) -> None:
        """Change the scene; ``is_a`` is that of :class:`State`, None if it stays."""
        now = self.state
        state = replace(now, scene=scene, mix=mix or now.mix, is_a=now.is_a if is_a is None else is_a)
        self._go(self.history.changed(state, gesture))

    def _go(self, history: History) -> None:
        """Take another history; after a drag, the object on screen keeps its edits, even if another one follows."""
        shown = self.scene
        if self.history.gesture and not history.gesture:
            self.objects.leave(self.state.version_of, shown.codes)
        self.history = history
        self.objects.unlist(history.now.removed)
        if not history.gesture:
            self.objects.leave(history.now.version_of, history.now.scene.codes)
        if history.now.scene != shown:
            self.scene_changed.emit()
