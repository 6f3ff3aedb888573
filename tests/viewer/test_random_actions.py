"""Random actions in the real window, from launch to launch; nothing that was made gets lost, and no error is logged.

By hand for ten minutes: ``RANDOM_SECONDS=600 python -m pytest -n 0 -m slow tests/viewer/test_random_actions.py``.
"""

import logging
import os
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest
from imgui_bundle import ImVec2, imgui
from PIL import Image

from core.fitting.fit import FitJob, FitStep
from core.models.model import Model
from tests.viewer.driver import Drive, Driver
from tests.viewer.stand_ins import codes_key, detailed_fit, shifted, two_models
from viewer.services.backend import Backend
from viewer.services.messages import MessageKind
from viewer.store import store
from viewer.values import history
from viewer.values.share_settings import ShareSettings

_SECONDS = float(os.environ.get("RANDOM_SECONDS", "20"))  # s of actions for each seed
_ACTIONS = 25  # actions of a run of the window, at most

Key = tuple[str, bytes, bytes]  # codes to compare: model, shape, texture


def varied_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
    """As :func:`detailed_fit`, but slower, and each photo has codes of its own."""
    shift = float(job.photos[0].pixels.double().mean())
    for step in detailed_fit(model, job):
        time.sleep(0.03)
        yield replace(step, instance=shifted(step.instance, shift))


class Made:
    """Originals of all objects, and codes of all states; those since the last save may be lost by a kill.

    Trained objects are left out, as no file keeps the state that an empty project begins with.
    """

    def __init__(self) -> None:
        self.log = list[str]()  # actions
        self.objects = set[Key]()
        self.shown = set[Key]()
        self._trained = {codes_key(model[index]) for model in two_models().values() for index in model.codes.valid}
        self._newest: tuple[set[Key], set[Key]] = set(), set()
        self._descriptions = dict[Key, str]()

    def observe(self, window: Driver) -> None:
        """Take note of all objects and states; call after each action."""
        editor = window.session.editor
        if editor.history.gesture:
            return
        objects = {codes_key(added.original): f"object {added.name}" for added in editor.objects.ever_added}
        steps = editor.history.steps.values()
        states = {codes_key(state.scene.instance): f"state of {state.mix.a.words()}" for state, _ in steps}
        self._descriptions |= {name: f"{text} at {len(self.log)}" for name, text in (states | objects).items()}
        self._newest[0].update(objects.keys() - self._trained)
        self._newest[1].update(states.keys() - self._trained)
        if window.session.recording.is_up_to_date:
            self.keep()

    def keep(self) -> None:
        """All that was observed is saved."""
        self.objects |= self._newest[0]
        self.shown |= self._newest[1]
        self._newest = set(), set()

    def keep_all(self, window: Driver) -> None:
        """Observe the last edit before the window saves it when closing."""
        window.wait()
        window.session.editor.end_gesture()
        self.observe(window)
        self.keep()

    def assert_all_kept(self, window: Driver) -> None:
        """Fail if a saved object or state is neither in an earlier session nor in the library."""
        window.wait(lambda: not window.session.fitting.pending)
        window.session.new()  # all history is in files of earlier sessions
        assert _errors(window) == []
        session = window.session
        read = [session.store.session(earlier.number, session.editor.state) for earlier in session.store.earlier]
        projects = [project.adopted(session.models) for project in read]
        stored = [item for project in projects for item in project.objects] + list(window.session.editor.objects.added)
        states = [state for project in projects for state, _ in project.history.steps.values()]
        lost = self.objects - {codes_key(item.original) for item in stored}
        lost |= self.shown - {codes_key(state.scene.instance) for state in states}
        assert not lost, ([self._descriptions[name] for name in lost], [*enumerate(self.log, 1)])

    def forget_newest(self) -> None:
        """Leave out what was observed since the last save: the window was killed."""
        self._newest = set(), set()


class Person:
    """Does random things, mostly with mouse and keys."""

    def __init__(self, window: Driver, random: Random, folder: Path) -> None:
        self.window = window
        self.random = random
        self.folder = folder
        self.session = window.session
        self._saved = folder / "saved.codenerf"
        self._look = folder / "look.json"
        self.likely: dict[Callable[[], None], int] = {
            self.orbit: 6,
            self.slide: 4,
            self.paint: 4,
            self.mix: 3,
            self.undo: 6,
            self.redo: 4,
            self.click_history: 6,
            self.show: 4,
            self.click_menu: 3,
            self.remove: 2,
            self.press_message: 2,
            self.sample: 1,
            self.export: 1,
            self.drop: 3,
            self.import_look: 1,
            self.save: 2,
            self.open: 1,
            self.begin_anew: 1,
            self.rest: 3,
        }

    def act(self) -> str:
        """Do something and return its name."""
        (action,) = self.random.choices([*self.likely], [*self.likely.values()])
        action()
        self.window.ctx.yield_(self.random.randint(1, 6))
        return action.__name__

    def _click(self, name: str, button: int = 0) -> bool:
        """Click where a widget is, if it is there; something else may have taken its place, as for a person."""
        if middle := self._place(name):
            self.window.ctx.mouse_move_to_pos(middle)
            self.window.ctx.mouse_click(button)
        return middle is not None

    def _place(self, name: str) -> ImVec2 | None:
        """The middle of what is seen of a widget, if it is there."""
        quiet = imgui.test_engine.TestOpFlags_.no_error
        info = self.window.ctx.item_info(f"//{name}", quiet)
        return info.rect_clipped.get_center() if info.id_ else None

    def _drag(self, start: ImVec2 | None) -> None:
        """Drag from a place by a random amount."""
        if start is not None:
            self.window.ctx.mouse_move_to_pos(start)
            self.window.ctx.mouse_down(0)
            self.window.ctx.mouse_move_to_pos(start + ImVec2(self._amount(), self._amount()))
            self.window.ctx.mouse_up(0)

    def _choose(self, name: str, item: str) -> None:
        """Choose from an object's menu, and close it if it has no such item."""
        self._click(f"Library/**/show {name}", 1)
        self._click(f"**/{item}")
        self.window.press(imgui.Key.escape)

    def _amount(self) -> float:
        return self.random.choice((-1, 1)) * self.random.uniform(5, 60)

    def orbit(self) -> None:
        low, high = self.window.context.view
        self._drag(low + (high - low) * 0.3)  # no message is there

    def slide(self) -> None:
        self.window.show("Sliders")
        self._drag(self._place(f"Sliders/**/##{self.random.choice(('shape', 'texture'))} 1"))

    def paint(self) -> None:
        self.session.painting.paint((self.random.random(), self.random.random(), self.random.random()))
        self.session.painting.release()

    def mix(self) -> None:
        self.window.show("Mix")
        self._drag(self._place("Mix/mix pad"))

    def undo(self) -> None:
        for _ in range(self.random.randint(1, 4)):
            self.window.undo()

    def redo(self) -> None:
        for _ in range(self.random.randint(1, 4)):
            self.window.redo()

    def click_history(self) -> None:
        kind = self.random.choice(("state", "branch"))
        tiles = [name for number in range(1, 30) if self._place(name := f"History/{kind} {number}")]
        if tiles:
            self._click(self.random.choice(tiles))

    def _tile(self) -> str:
        """An object's tile that is drawn, of the added ones if there are any; its name, or none."""
        self._click(f"Library/**/###{self.random.choice(('all', 'mine', 'mine'))}")
        objects = self.session.editor.objects
        names = objects.own if objects.own and self.random.random() < 0.7 else [*next(iter(objects.families.values()))]
        drawn = [name for name in names if self._place(f"Library/**/show {name}")]
        return self.random.choice(drawn) if drawn else ""

    def show(self) -> None:
        if name := self._tile():
            self._click(f"Library/**/show {name}")

    def click_menu(self) -> None:
        name = self._tile()
        if name in self.session.editor.objects.own:
            self._choose(name, "###keep version")
            if self._place(version := f"Library/**/version {self.random.randrange(2)} of {name}"):
                self._click(version)

    def remove(self) -> None:
        name = self._tile()
        if name in self.session.editor.objects.own:
            self._choose(name, "###remove object")

    def press_message(self) -> None:
        buttons = [f"##MainMenuBar/##MenuBar/###{label}" for label in ("undo", "show", "ok", "dismiss")]
        if visible := [name for name in buttons if self._place(name)]:
            self._click(self.random.choice(visible))

    def sample(self) -> None:
        self.window.press(imgui.Key.r)

    def export(self) -> None:
        if not self.session.exporting.running:
            self.session.exporting.share(self.folder / "turn.gif", ShareSettings("turntable", size=16))

    def drop(self) -> None:
        path = self.folder / f"block {self.random.randrange(10**6)}.png"
        colour = tuple(self.random.randrange(10, 200) for _ in range(3))
        image = Image.new("RGB", (96, 96), "white")
        image.paste(colour, (30, 20, 66, 80))
        image.save(path)
        self.window.context.drop([str(path)])

    def import_look(self) -> None:
        if self._look.exists():
            self.window.context.drop([str(self._look)])
        self.session.editor.scene.save(self._look)

    def save(self) -> None:
        self.session.save_project(self._saved.with_stem(f"saved {self.random.randrange(3)}"))

    def open(self) -> None:
        if saved := sorted(self.folder.glob("saved*.codenerf")):
            self.window.context.drop([str(self.random.choice(saved))])

    def begin_anew(self) -> None:
        self.window.press(imgui.Key.mod_ctrl, imgui.Key.n)

    def rest(self) -> None:
        self.window.ctx.yield_(self.random.randint(10, 60))


@pytest.mark.slow  # as long as it is told to
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_nothing_is_lost_and_no_error_is_logged(
    drive: Drive,
    both: Backend,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    seed: int,
) -> None:
    monkeypatch.setattr(store, "EARLIER", 10_000)  # nothing is dropped because it is old
    monkeypatch.setattr(history, "DEPTH", 10_000)
    random = Random(seed)
    end = time.monotonic() + _SECONDS
    backend = replace(both, fit=varied_fit)
    made = Made()
    folders = [tmp_path / "run 0"]

    def run(window: Driver) -> None:
        person = Person(window, random, tmp_path)
        killed = random.random() < 0.5
        made.log.append("launch")
        made.observe(window)
        for _ in range(random.randint(2, _ACTIONS)):
            made.log.append(person.act())
            made.observe(window)
            assert _errors(window) == [], made.log[-10:]
            if time.monotonic() > end:
                break
        made.log.append("kill" if killed else "close")
        if killed:
            folders.append(tmp_path / f"run {len(folders)}")
            shutil.copytree(folders[-2], folders[-1], ignore=shutil.ignore_patterns(".*"))
            made.forget_newest()
        else:
            made.keep_all(window)

    while time.monotonic() < end:
        drive(run, backend, random.choice(((1280, 800), (900, 600))), folder=folders[-1])
    drive(made.assert_all_kept, backend, folder=folders[-1])
    assert [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR] == []


def _errors(window: Driver) -> list[str]:
    problems = [message for message in window.session.messages.log if message.kind is MessageKind.PROBLEM]
    return [f"{message.text} {message.detail}" for message in problems]
