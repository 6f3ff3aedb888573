"""The only mutable state: what is open, shown and under way. Knows no window, so it is tested without one."""

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor

from core.export.keyframes import Timeline
from core.fitting.fit import FitJob, FitStep, fit
from core.geometry.camera import Camera
from core.models.codes import CodeBook, Codes, CodeSpace
from core.models.library import load_model
from core.models.model import Model
from core.models.pictures import open_scene
from core.models.scene import Scene
from core.photos.photo import Photo, load_photo
from core.photos.view_bank import preparing
from core.rendering.progressive import Frame, RenderJob, frames
from viewer.activities.exporting import Exporting, film, mesh
from viewer.activities.fitting import Fitting
from viewer.activities.grid import Sheet
from viewer.activities.player import Film
from viewer.activities.segmenting import Cutting
from viewer.activities.thumbnails import Stills
from viewer.activities.viewport import Viewport
from viewer.services.clipboard import Clipboard
from viewer.services.messages import Kind, Message, explain
from viewer.services.worker import Job, Worker
from viewer.values import orbit
from viewer.values.history import History, Mix, Pair, State
from viewer.values.objects import Gallery, Thing
from viewer.values.saved_session import Saved

Part = Literal["shape", "texture"]
_BESIDE = 0.2
"""Share of the worker for what will be wanted soon."""
_NEWS = 3
"""Lines of information that stay beside a new one, until they fade."""
PARTS: tuple[Part, Part] = ("shape", "texture")


@dataclass(frozen=True)
class Streams:
    """Where values come from: core, or a test's stand-ins."""

    load_model: Callable[[str], Model] = load_model
    load_photo: Callable[..., Photo] = load_photo
    frames: Callable[[Model, RenderJob], Iterator[Frame | None]] = frames
    fit: Callable[[Model, FitJob], Iterator[FitStep]] = fit
    preparing: Callable[[Model], Iterator[None]] = preparing
    film: Callable[..., Iterator[int]] = film
    mesh: Callable[..., Iterator[float]] = mesh


class Session:
    """Panels read its attributes and call its methods; jobs come back to it through the worker."""

    def __init__(self, worker: Worker, streams: Streams | None = None, seed: int | None = None) -> None:
        self.worker = worker
        self.streams = streams or Streams()
        self.model: Model | None = None
        self.opened = ""
        """the name of the model that is there"""
        self.loading = ""
        """the name of the model on its way"""
        self._wishes: list[Callable[[], None]] = []
        """what was asked for while the model was on its way"""
        self._left: dict[str, Saved] = {}
        """by the name of their model, sessions that were left for another model"""
        self.history: History | None = None
        self.locked: frozenset[Part] = frozenset()
        """what no edit of codes changes; opening a scene or a fit does, and undo"""
        self.messages: list[Message] = []
        self.viewport = Viewport(self)
        self.gallery = Gallery(self)
        self.sheet = Sheet(self)
        self.fitting = Fitting(self)
        self.cutting = Cutting(self)
        self.exporting = Exporting(self)
        self.clipboard = Clipboard()
        self.film = Film(self)
        self.stills = Stills(self)
        self._nearest: dict[Part, tuple[Tensor, tuple[str, float]]] = {}
        """for each kind the code that was last asked for, and the answer"""
        self._random = torch.Generator()
        self._random.manual_seed(seed) if seed is not None else self._random.seed()

    # What there is

    @property
    def state(self) -> State:
        """What is being edited. Only once a model is there."""
        assert self.history is not None, "no model yet"
        return self.history.now

    @property
    def scene(self) -> Scene:
        """The scene on screen. Only once a model is there."""
        return self.state.scene

    @property
    def errors(self) -> list[str]:
        """What went wrong and was not put away."""
        return [message.text for message in self.messages if message.kind is Kind.ERROR]

    @property
    def ready(self) -> bool:
        """A model is there."""
        return self.model is not None

    def space(self, part: Part) -> CodeSpace:
        """The cloud of the trained codes of one kind."""
        assert self.model is not None, "no model yet"
        return self.model.codes.shape_space if part == "shape" else self.model.codes.texture_space

    def code(self, part: Part) -> Tensor:
        """The current code of one kind."""
        return getattr(self.scene.codes, part)

    def pair(self, pair: Pair) -> Codes:
        """The shape of one object in the texture of another."""
        return Codes(self.gallery[pair.shape].codes.shape, self.gallery[pair.texture].codes.texture)

    def distance(self, part: Part) -> float:
        """From the current code to the mean of the trained ones, in standard deviations; a trained one has about 1."""
        return float(self.space(part).distance(self.code(part)))

    def nearest(self, part: Part) -> tuple[str, float] | None:
        """The trained object whose code of one kind is nearest, and how far it is (standard deviations)."""
        if self.model is None or not self.model.codes.sound:
            return None
        code, known = self.code(part), self._nearest.get(part)
        if known is None or known[0] is not code:  # panels ask in every frame, and an edit makes another tensor
            known = self._nearest[part] = (code, self._search_nearest(self.model.codes, part, code))
        return known[1]

    def tick(self) -> None:
        """Once a frame: what came from the worker, and what goes on by itself."""
        self.worker.deliver()
        self.film.tick()
        self.stills.tick()

    # The model

    def open_model(self, name: str) -> None:
        """Load a model, by shipped name or path. What is open stays until it is there; what was made with the model
        comes back with it.
        """
        self.loading = name

        def ended(error: Exception | None) -> None:
            if error:
                self.loading = ""
                self._wishes.clear()
                self.report(f"Cannot open the model {name}", error)

        def opened(model: Model) -> None:
            if self.history and self.history.past:
                self._left[self.opened] = Saved.of(self.opened, self.state, self.gallery.added)
            self.opened, self.loading = name, ""
            self._opened(model)
            if left := self._left.pop(name, None):
                self.restore(left)
            wishes, self._wishes = self._wishes, []
            for wish in wishes:
                wish()

        self.worker.submit(Job("model", lambda: (self.streams.load_model(name),), opened, ended))

    def when_ready(self, wish: Callable[[], None]) -> bool:
        """Put a wish off until the model on its way is there. Whether it was put off."""
        if self.model is not None and not self.loading:
            return False
        self._wishes.append(wish)
        return True

    def _opened(self, model: Model) -> None:
        self.fitting.reset()
        self.viewport.clear()
        self.cutting.close()
        self.exporting.cancel()
        self.model, self.locked = model, frozenset()
        self.gallery.open(model)
        self.sheet.clear()
        self.stills.clear()
        self.film.rewind()
        first, second = self.gallery.names[0], self.gallery.names[min(1, len(self.gallery.names) - 1)]
        scene = Scene(model.fingerprint, self.gallery[first].codes, orbit.home(model))
        self.history = History(State(scene, Mix(Pair(first, first), second)))
        self.viewport.render()
        self.worker.submit(Job("bank", lambda: self.streams.preparing(model), lambda _: None, share=_BESIDE))

    # Edits: each is one step of undo, or joins the drag it belongs to

    def look(self, camera: Camera, gesture: str = "") -> None:
        """See the object from another place."""
        self._edit(replace(self.scene, camera=camera), gesture=gesture)

    def reset_view(self) -> None:
        """Back to where a model is first seen from."""
        assert self.model is not None, "no model yet"
        pan = self.viewport.pan
        if pan != (0.0, 0.0):
            self.viewport.push(-pan[0], -pan[1])
        self.look(orbit.home(self.model))

    def see_from(self, view: str) -> None:
        """One of :data:`~viewer.values.orbit.VIEWS`, the first view (home), or the last photo's camera, if there is one."""
        if view == "home":
            self.reset_view()
        elif view == "photo" and self.fitting.course.last:
            self.look(self.fitting.camera)
        elif view in orbit.VIEWS:
            self.look(orbit.seen_from(self.scene.camera, view))

    def set_code(self, part: Part, code: Tensor, gesture: str = "") -> None:
        """Give the object another shape, or another texture."""
        self._recode(replace(self.scene.codes, **{part: code}), self.state.mix, gesture)

    def move_along(self, part: Part, direction: int, to: float, gesture: str = "") -> None:
        """Set one coordinate of a code, in standard deviations along a principal direction."""
        self.set_code(part, self.space(part).moved(self.code(part), direction, to), gesture)

    def pull(self, part: Part, to: float, gesture: str = "") -> None:
        """Move a code straight towards the mean, or away from it, to a distance (standard deviations, over 0)."""
        mean, distance = self.space(part).mean, self.distance(part)
        if distance > 0:
            self.set_code(part, mean + (self.code(part) - mean) * (to / distance), gesture)

    def to_mean(self, part: Part) -> None:
        """The mean of the trained codes."""
        self.set_code(part, self.space(part).mean)

    def to_object(self, part: Part) -> None:
        """Back to the code of object A."""
        self.set_code(part, getattr(self.pair(self.state.mix.a), part))

    def randomise(self, part: Part) -> None:
        """A code drawn from the cloud of the trained ones, taken as normal."""
        assert self.model is not None, "no model yet"
        self.set_code(part, getattr(self.model.codes.drawn(self._random), part))

    def randomise_all(self) -> None:
        """Shape and texture drawn at random; what is locked stays."""
        assert self.model is not None, "no model yet"
        self._recode(self.model.codes.drawn(self._random), self.state.mix)

    def show(self, name: str) -> None:
        """Make an object current; it becomes A, and both sliders go to A."""
        self.show_pair(Pair(name, name))

    def show_pair(self, pair: Pair) -> None:
        """Make current the shape of one object in the texture of another; the pair becomes A."""
        self._recode(self.pair(pair), Mix(pair, self.state.mix.b))

    def take(self, part: Part, name: str) -> None:
        """Take only the shape, or only the texture, of an object; its slider goes to A."""
        mix = self.state.mix
        mix = replace(mix, a=mix.a._replace(**{part: name})).slid(part, 0.0)
        self._recode(self._with(part, getattr(self.gallery[name].codes, part)), mix)

    def swap(self) -> None:
        """A's shape from where its texture was taken, and the other way round; the sliders stay where they are."""
        mix = self.state.mix
        self._slide(replace(mix, a=Pair(mix.a.texture, mix.a.shape)), PARTS)

    def pick_b(self, name: str) -> None:
        """Choose where the sliders lead. What they have already mixed in is taken from the new object."""
        assert self.gallery[name]
        mix = replace(self.state.mix, b=name)
        codes = self.scene.codes
        for part in PARTS:
            if getattr(mix, part) > 0:
                codes = replace(codes, **{part: getattr(self._mixed(mix), part)})
        self._recode(codes, mix)

    def mix(self, part: Part, amount: float, gesture: str = "") -> None:
        """Slide the shape, or the texture, from A (0) to B (1). The other stays as it is."""
        self._slide(self.state.mix.slid(part, amount), (part,), gesture)

    def mix_both(self, shape: float, texture: float, gesture: str = "") -> None:
        """Slide both at once, each from A (0) to B (1)."""
        self._slide(replace(self.state.mix, shape=shape, texture=texture), PARTS, gesture)

    def adopt(self, thing: Thing, camera: Camera) -> None:
        """Take an object among the objects and make it current, as A, seen from a camera."""
        name = self.gallery.add(thing)
        self._edit(replace(self.scene, codes=thing.codes, camera=camera), Mix(Pair(name, name), self.state.mix.b))

    def visit(self, codes: Codes, camera: Camera, gesture: str = "") -> None:
        """Show codes and the camera they belong to, such as a fit had on its way, or a film has at a time."""
        self._edit(replace(self.scene, codes=codes, camera=camera), gesture=gesture)

    def load_scene(self, path: Path) -> None:
        """Open a scene, or a picture that holds one: its object joins the objects. What cannot be read, or is of
        another model, changes nothing.
        """
        if self.when_ready(lambda: self.load_scene(path)):
            return
        assert self.model is not None
        try:
            scene = open_scene(path, self.model)
        except ValueError as error:
            self.report("Cannot open the scene", error)
        else:
            self.adopt(Thing(path.stem, scene.codes), scene.camera)
            self.say(f"Opened {path.name}")

    def retime(self, timeline: Timeline, gesture: str = "") -> None:
        """Change the film; what is shown stays."""
        assert self.history is not None, "no model yet"
        self._go(self.history.changed(replace(self.state, timeline=timeline), gesture))

    def restore(self, saved: Saved, done: Callable[[], None] = lambda: None) -> None:
        """Go on with a session that was put away, its model first; what cannot be read changes nothing.

        Args:
            done: called once all of it is back.
        """
        if self.model is None or self.loading or self.opened != saved.model:
            if (self.loading or self.opened) != saved.model:
                self.open_model(saved.model)
            self.when_ready(lambda: self.restore(saved, done))
            return
        try:
            state, things = saved.restored(self.model)
            here = {*self.gallery.names, *(thing.name for thing in things)}
            if not here.issuperset((*state.mix.a, state.mix.b)):
                raise ValueError("it mixes objects that are not here")
        except ValueError as error:
            self.report("Cannot restore the session", error)
            return
        names = {name: name for name in self.gallery.names}
        for thing in things:
            if thing.name not in names or self.gallery[thing.name].codes != thing.codes:
                names[thing.name] = self.gallery.add(thing)
        mix = replace(state.mix, a=Pair(*(names[name] for name in state.mix.a)), b=names[state.mix.b])
        assert self.history is not None
        self._go(self.history.changed(replace(state, mix=mix)))
        self.say("Restored the session")
        done()

    def settle(self) -> None:
        """The hand has let go: the next edit is a step of its own."""
        if self.history and self.history.gesture:
            self.history = self.history.settled()

    def undo(self) -> None:
        """One edit back."""
        if self.history:
            self._go(self.history.undone())

    def redo(self) -> None:
        """One edit forward again."""
        if self.history:
            self._go(self.history.redone())

    def return_to(self, index: int) -> None:
        """Back, or forward, to one of the states that undo remembers."""
        if self.history:
            self._go(self.history.gone(index))

    # Nothing to undo

    def lock(self, part: Part, locked: bool) -> None:
        """Keep the shape, or the texture, from being changed; or let it go again."""
        self.locked = self.locked | {part} if locked else self.locked - {part}

    def save_scene(self, path: Path) -> None:
        """Write the scene as JSON."""
        try:
            self.scene.save(path)
        except ValueError as error:
            self.report("Cannot save the scene", error)
        else:
            self.say(f"Saved {path.name}")

    def say(self, text: str, kind: Kind = Kind.INFO) -> None:
        """Show a line in the window, in place of the same one, if that is still there."""
        left = [
            message for message in self.messages if not message.faded and (message.text, message.kind) != (text, kind)
        ]
        news = [message for message in left if message.kind is Kind.INFO][:-_NEWS]
        self.messages = [*(message for message in left if message not in news), Message(text, kind)]

    def report(self, what: str, error: Exception) -> None:
        """Show what went wrong; what nobody foresaw is logged with its trace as well."""
        if not isinstance(error, ValueError | OSError | MemoryError):
            logging.getLogger(__name__).error(what, exc_info=error)
        self.say(f"{what}: {explain(error)}", Kind.ERROR)

    def reporting(self, what: str) -> Callable[[Exception | None], None]:
        """For the end of a job: reports what went wrong, if anything did."""
        return lambda error: self.report(what, error) if error else None

    def dismiss(self, message: Message) -> None:
        """Put a message away."""
        self.messages = [other for other in self.messages if other is not message]

    def _search_nearest(self, book: CodeBook, part: Part, code: Tensor) -> tuple[str, float]:
        index = book.nearest_shape(code) if part == "shape" else book.nearest_texture(code)
        away = self.space(part).distance(code, getattr(book[index], part))
        return book.objects[index].name, float(away)

    def _with(self, part: Part, code: Tensor) -> Codes:
        return replace(self.scene.codes, **{part: code})

    def _mixed(self, mix: Mix) -> Codes:
        return self.pair(mix.a).mixed(self.gallery[mix.b].codes, mix.shape, mix.texture)

    def _slide(self, mix: Mix, parts: tuple[Part, ...], gesture: str = "") -> None:
        mixed = self._mixed(mix)
        self._recode(replace(self.scene.codes, **{part: getattr(mixed, part) for part in parts}), mix, gesture)

    def _recode(self, codes: Codes, mix: Mix, gesture: str = "") -> None:
        """An edit of codes. What is locked stays as it is: its code, where it is from, and its slider."""
        now = self.state
        for part in self.locked:
            codes = replace(codes, **{part: getattr(now.scene.codes, part)})
            a = mix.a._replace(**{part: getattr(now.mix.a, part)})
            mix = replace(mix, a=a).slid(part, getattr(now.mix, part))
        self._edit(replace(now.scene, codes=codes), mix, gesture)

    def _edit(self, scene: Scene, mix: Mix | None = None, gesture: str = "") -> None:
        assert self.history is not None, "no model yet"
        self._go(self.history.changed(replace(self.state, scene=scene, mix=mix or self.state.mix), gesture))

    def _go(self, history: History) -> None:
        seen = self.scene
        self.history = history
        if history.now.scene != seen:
            self.viewport.render()
