"""The real window driven by name, and sessions brought to rest."""

import time
from collections.abc import Callable
from dataclasses import replace
from inspect import Signature, signature
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest
from imgui_bundle import hello_imgui, imgui
from imgui_bundle.immapp import testing
from PIL import Image

from tests.viewer.machine import Patience
from viewer.actions import chord
from viewer.activities.fitting import Fitting
from viewer.app import App
from viewer.editor import Editor
from viewer.session import Session
from viewer.store.files import read_project
from viewer.values.project import Project

Drive = Callable[..., None]


def in_window(
    fixture: str = "backend", size: tuple[int, int] = (1280, 800), strict: bool = True, **stand_ins: Any
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a test the real window as its argument ``window``; its others are fixtures.

    Args:
        fixture: name of the fixture of the window's backend.
        stand_ins: functions of the backend that are replaced.
    """

    def decorate(act: Callable[..., None]) -> Callable[..., None]:
        def test(drive: Drive, request: pytest.FixtureRequest, **fixtures: object) -> None:
            backend = replace(request.getfixturevalue(fixture), **stand_ins)
            drive(lambda window: act(window, **fixtures), backend, size, strict)

        outer, inner = (list(signature(function).parameters.values()) for function in (test, act))
        test.__signature__ = Signature([*outer[:2], *inner[1:]])  # by which pytest finds the fixtures
        test.__name__ = act.__name__
        test.__doc__ = act.__doc__
        test.__module__ = act.__module__
        return test

    return decorate


def tooltip(window: "Driver") -> imgui.internal.Window | None:
    """Return the tooltip on screen, if any."""
    box = window.ctx.window_info("//##Tooltip_00", imgui.test_engine.TestOpFlags_.no_error).window
    return box if box is not None and box.active and not box.hidden else None


_RASTERIZER_DISCARD = 0x8C89
"""of OpenGL: everything is drawn but no pixel is coloured"""


def deliver(session: Session, until: Callable[[], bool], longest: float = 60.0) -> None:
    """Deliver until something holds."""
    patience = Patience(longest)
    session.tick()
    while not until():
        session.tick()
        assert not patience.is_over(), "the worker does not come to an end"
        time.sleep(0.002)


def finish(session: Session, until: Callable[[], bool] = lambda: True, longest: float = 60.0) -> None:
    """Deliver until nothing is under way and ``until`` holds."""
    deliver(session, lambda: not session.jobs.busy() and until(), longest)


def fit(session: Session, *photos: Path) -> None:
    """Fit photos as one object, and deliver until no fit runs."""
    session.fitting.start(*photos)
    finish(session, lambda: not session.fitting.running)


def press(session: Session, label: str) -> None:
    """Press a button of the newest message."""
    next(button for button in session.messages.newest.buttons if button.label == label).press()


def keep(session: Session) -> None:
    """Deliver until all that was made is in the store."""
    deliver(session, lambda: session.recording.is_up_to_date)


def opened(path: Path, session: Session) -> Project:
    """The project in a file, with objects of a session's models."""
    return read_project(path).adopted(session.models)


class Driver:
    """A window under test: its widgets by name, and time to let things happen."""

    def __init__(self, app: App, ctx: imgui.test_engine.TestContext, folder: Path) -> None:
        self.app = app
        self.ctx = ctx
        self.folder = folder
        self.session = app.session
        self.context = app.context
        self._colours_pixels = False
        self._leave_pixels_out()
        io = imgui.test_engine.get_io(hello_imgui.get_imgui_test_engine())
        # A slow machine takes as long as it takes; waits end by themselves.
        io.config_watchdog_warning = io.config_watchdog_kill_test = io.config_watchdog_kill_app = 1e9

    @property
    def editor(self) -> Editor:
        """The editor, which New and projects replace."""
        return self.session.editor

    @property
    def fitting(self) -> Fitting:
        """The fits, which New and projects replace."""
        return self.session.fitting

    def wait(self, until: Callable[[], bool] | None = None, longest: float = 60.0) -> None:
        """Draw until a condition holds; without one, until nothing is under way."""
        patience = Patience(longest)
        while not (until() if until else not self.session.jobs.busy()):
            self.ctx.yield_()
            assert not patience.is_over(), "waited in vain"
            time.sleep(0.005)
        self.ctx.yield_(3)

    def wait_for_view(self) -> None:
        """Draw until the view shows its finished render; thumbnails may still be missing."""
        self.wait(lambda: not self.session.jobs.busy("view"))

    def click(self, name: str, button: int = 0) -> None:
        """Click a widget: ``Panel/widget`` or, at any depth, ``**/widget``."""
        self.ctx.item_click(f"//{name}", button)
        self._check(name)

    def drag(self, name: str, across: float, down: float = 0.0) -> None:
        """Press on the middle of a widget, move so many px, release."""
        self.ctx.item_drag_with_delta(f"//{name}", (across, down))
        self._check(name)

    def drop(self, name: str, onto: str) -> None:
        """Drag a widget onto another."""
        self.ctx.item_drag_and_drop(f"//{name}", f"//{onto}")
        self._check(f"{name} or {onto}")

    def choose(self, name: str, item: str) -> None:
        """Choose from the menu of an object."""
        self.click(f"Library/**/show {name}", 1)
        self.click(f"**/{item}")

    def set(self, name: str, value: float) -> None:
        """Type a value into a slider."""
        self.ctx.item_input_value(f"//{name}", value)
        self._check(name)

    def menu(self, path: str) -> None:
        """Click an item of the menu bar, by ids: ``File/###paste``."""
        self.ctx.set_ref("##MainMenuBar")
        self.ctx.menu_click(path)
        self._check(path)

    def exists(self, name: str) -> bool:
        """Whether a widget is there."""
        return self.ctx.item_exists(f"//{name}")

    def type(self, text: str) -> None:
        """Answer the question for a file."""
        self.ctx.yield_(3)
        self.ctx.item_click("//Choose a file###ask/##path")
        self.ctx.key_chars_replace(text)
        self.ctx.item_click("//Choose a file###ask/###choose")
        self.ctx.yield_(2)
        self._check(text)

    def press(self, *keys: imgui.Key) -> None:
        """Press keys together."""
        self.ctx.key_press(chord(*keys))
        self.ctx.yield_(2)

    def undo(self) -> None:
        """Ctrl+Z."""
        self.press(imgui.Key.mod_ctrl, imgui.Key.z)

    def redo(self) -> None:
        """Ctrl+Y."""
        self.press(imgui.Key.mod_ctrl, imgui.Key.y)

    def show(self, panel: str) -> None:
        """Bring a panel to the front."""
        self.context.focus = panel
        self.ctx.yield_(3)

    def fit(self, *photos: Path) -> None:
        """Drop photos and wait for the result."""
        self.context.drop([str(photo) for photo in photos])
        self.wait(lambda: not self.session.fitting.running and not self.session.jobs.busy("fit"))
        self.wait()

    def ask_about(self, photo: Path) -> None:
        """Drop a photo and wait for the question about it."""
        self.context.drop([str(photo)])
        self.wait(lambda: bool(self.fitting.questions))

    def capture(self) -> np.ndarray:
        """What the whole window shows, (height, width, 3), as float."""
        path = self.folder / "window.png"
        self._colours_pixels = True
        testing.capture(self.ctx, str(path))
        self._colours_pixels = False
        with Image.open(path) as image:
            return np.asarray(image.convert("RGB")).astype(float)

    def capture_view(self, border: int = 0) -> np.ndarray:
        """What the view shows, but so many px at its top and bottom."""
        low, high = self.context.view
        self.ctx.mouse_move_to_pos((1.0, 1.0))  # no part of the object lights up
        return self.capture()[int(low.y) + border : int(high.y) - border, int(low.x) : int(high.x)]

    def _leave_pixels_out(self) -> None:
        """Colour no pixel of a frame that nobody looks at: in software these are nine tenths of a frame's time."""
        gl = moderngl.get_context()
        calls = self.app.params.callbacks
        begin = calls.before_imgui_render
        finish = calls.after_swap

        def before() -> None:
            begin()
            if not self._colours_pixels:
                gl.enable_direct(_RASTERIZER_DISCARD)

        def after() -> None:
            gl.disable_direct(_RASTERIZER_DISCARD)
            finish()

        calls.before_imgui_render = before
        calls.after_swap = after

    def _check(self, name: str) -> None:
        self.ctx.yield_(2)
        assert not self.ctx.is_error(), f"no such widget: {name}"
