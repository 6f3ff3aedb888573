"""The real window driven by name, waiting for the worker, and stand-ins for what takes minutes."""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from imgui_bundle import imgui
from PIL import Image

from core.fitting.fit import Alternative, FitJob, FitStep, Hypothesis
from core.models.model import Model
from core.photos.photo import Photo, load_photo
from core.rendering.progressive import Frame, RenderJob
from viewer.context import chord
from viewer.session import Session


def quick_frames(model: Model, job: RenderJob) -> Iterator[Frame | None]:
    """A disc whose colour follows the texture, its size the shape and the distance, its place the camera's angles."""
    codes, camera, stages = job.codes, job.camera, job.settings.stages
    for stage, divisor in enumerate(stages):
        width, height = max(1, camera.width // divisor), max(1, camera.height // divisor)
        y, x = np.mgrid[0:height, 0:width] / min(width, height)
        across, down = width / height / 2 + 0.2 * math.sin(camera.azimuth), 0.5 + 0.2 * math.sin(camera.elevation)
        radius = (0.3 + 0.05 * math.tanh(float(codes.shape.sum()))) / camera.distance
        opacity = (np.hypot(x - across, y - down) < radius).astype(np.float32)
        colour = np.array([0.5 + 0.5 * math.tanh(value) for value in (codes.texture.tolist() * 3)[:3]])
        image = (255 * (1 - opacity[..., None] * (1 - colour))).astype(np.uint8)
        yield None
        yield Frame(image, opacity, opacity, stage, len(stages), job.settings.samples, 0.01 * (stage + 1))


def quick_photo(path: Path, model: Model, *told: object) -> Photo:
    """The real thing refuses what is no picture, but cannot frame a block for a model of mists."""
    if not path.stem.startswith("block"):
        return load_photo(path, model, *told)
    with Image.open(path) as image:
        pixels = torch.from_numpy(np.array(image.resize((32, 32)))) / 255
    return Photo(pixels, pixels.mean(-1) < 0.9)


def quick_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
    """Ten steps towards object 3, seen from azimuth 1 rad, or else from behind; four race, then two.

    Where it goes on, the camera is the given one.
    """
    given = [photo.camera for photo in job.photos]
    for step in range(10):
        codes = model.codes.mean.mixed(model.codes[3], step / 9, step / 9)
        loss, race = math.exp(-step), list[Hypothesis]()
        for start in range(4 if step < 5 else 2):
            height, width = job.photos[0].mask.shape
            camera = model.camera(1.0 + start * math.pi / 2, 0.3 + 0.01 * step).resized(width, height)
            begin = job.begin if not start else None
            first = begin.cameras if begin else (camera,) * len(job.photos)
            at = tuple(known or found for known, found in zip(given, first, strict=True))
            race.append(
                Hypothesis(
                    begin.start if begin else start, (1 + 0.1 * start) * loss, at, codes, torch.zeros(len(given), 2)
                )
            )
        behind = tuple(replace(camera, azimuth=camera.azimuth + math.pi) for camera in race[0].cameras)
        yield FitStep(
            *(step + 1, 10, 0, loss, 10.0 + step, 0.1 * step, race[0].cameras, codes, len(race)),
            alternative=Alternative(behind, 1.1 * loss),
            margin=math.log(1.1),
            spread=1.0,
            race=tuple(race),
        )


def endless_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
    """Never ends by itself."""
    while True:
        for step in quick_fit(model, job):
            time.sleep(0.01)
            yield step


def broken_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
    """Fails after three steps."""
    for step in quick_fit(model, job):
        if step.step == 4:
            raise ValueError("the loss is not finite")
        yield step


def deliver(session: Session, until: Callable[[], bool], longest: float = 60.0) -> None:
    """Deliver until something holds."""
    end = time.monotonic() + longest
    session.tick()
    while not until():
        session.tick()
        assert time.monotonic() < end, "the worker does not come to an end"
        time.sleep(0.002)


def finish(session: Session, until: Callable[[], bool] = lambda: True, longest: float = 60.0) -> None:
    """Deliver until nothing is under way and ``until`` holds."""
    deliver(session, lambda: not session.worker.busy() and until(), longest)


class Driver:
    """A window under test: its widgets by name, and time to let things happen."""

    def __init__(self, app, ctx) -> None:
        self.app, self.ctx = app, ctx
        self.session, self.desk = app.session, app.desk

    def wait(self, until: Callable[[], bool] | None = None, longest: float = 60.0) -> None:
        """Draw until a condition holds; without one, until nothing is under way."""
        end = time.monotonic() + longest
        while not (until() if until else not self.session.worker.busy()):
            self.ctx.yield_()
            assert time.monotonic() < end, "waited in vain"
            time.sleep(0.005)
        self.ctx.yield_(3)

    def click(self, name: str, button: int = 0) -> None:
        """Click a widget: ``Panel/widget`` or, at any depth, ``**/widget``."""
        self.ctx.item_click(f"//{name}", button)
        self._check(name)

    def drag(self, name: str, across: float, down: float = 0.0) -> None:
        """Press on the middle of a widget, move so many px, let go."""
        self.ctx.item_drag_with_delta(f"//{name}", (across, down))
        self._check(name)

    def drop(self, name: str, onto: str) -> None:
        """Drag a widget onto another."""
        self.ctx.item_drag_and_drop(f"//{name}", f"//{onto}")
        self._check(f"{name} or {onto}")

    def choose(self, thing: str, item: str) -> None:
        """Choose from the menu of an object."""
        self.click(f"Objects/**/show {thing}", 1)
        self.click(f"**/{item}")

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

    def show(self, panel: str) -> None:
        """Bring a panel to the front."""
        self.desk.focus = panel
        self.ctx.yield_(3)

    def _check(self, name: str) -> None:
        self.ctx.yield_(2)
        assert not self.ctx.is_error(), f"no such widget: {name}"
