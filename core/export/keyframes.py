"""Keyframes in time and the views between them: the camera moves on the sphere, codes are interpolated.

Between objects of two models the video cuts.
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from core.edits import kinds
from core.edits.edit import Edit
from core.geometry.camera import Camera
from core.models.latents import Latents
from core.models.model import Instance

if TYPE_CHECKING:
    from scipy.interpolate import CubicHermiteSpline

MIN_GAP = 0.04  # s between two keys: one frame
MIN_LENGTH, MAX_LENGTH = 0.2, 600.0  # s
TURN, SWING = 72, 96  # usual frames of a turn, and of a swing to both sides
_SWING_ANGLE = math.radians(70.0)  # to either side of a photo's camera: further round, the photo shows little
_MAX_ELEVATION = math.radians(89.0)  # short of the pole, since a smooth path may overshoot


class View(NamedTuple):
    """An object and a camera."""

    instance: Instance
    camera: Camera


class Keyframe(NamedTuple):
    """A view at a time."""

    seconds: float
    view: View


@dataclass(frozen=True)
class Timeline:
    """A video described by keyframes. Raises ``ValueError`` if keys are unordered, out of range or too close."""

    keys: tuple[Keyframe, ...] = ()
    length: float = 4.0  # s
    loop: bool = True  # True: continue from the last keyframe to the first; False: rest on the last
    turns: int = 0  # full turns of the camera around the object over the video, added to the keyframes' motion

    def __post_init__(self) -> None:
        if not MIN_LENGTH <= self.length <= MAX_LENGTH:
            raise ValueError(f"a video takes {MIN_LENGTH:g} to {MAX_LENGTH:g} s, got {self.length:g}")
        times = [key.seconds for key in self.keys]
        # A loop ends where it begins: a key at its end would coincide with one at its beginning.
        last = self.length - (MIN_GAP if self.loop else 0.0)
        if times and (times[0] < 0 or times[-1] > last + 1e-6 or min(np.diff(times), default=MIN_GAP) < MIN_GAP - 1e-6):
            raise ValueError(f"keys must be {MIN_GAP:g} s apart within the video, got {times}")

    # Edits: each is a new timeline

    def added(self, seconds: float, view: View) -> "Timeline":
        """Add a key and remove others within :data:`MIN_GAP`."""
        seconds = max(0.0, min(seconds, self.length - (MIN_GAP if self.loop else 0.0)))
        left = [key for key in self.keys if abs(key.seconds - seconds) >= MIN_GAP]
        return replace(self, keys=tuple(sorted((*left, Keyframe(seconds, view)), key=lambda key: key.seconds)))

    def removed(self, index: int) -> "Timeline":
        """Remove a key."""
        return replace(self, keys=(*self.keys[:index], *self.keys[index + 1 :]))

    def moved(self, index: int, seconds: float) -> "Timeline":
        """Move a key to another time, at most up to its neighbours."""
        low = self.keys[index - 1].seconds + MIN_GAP if index else 0.0
        high = self.length - (MIN_GAP if self.loop else 0.0)
        if index + 1 < len(self.keys):
            high = self.keys[index + 1].seconds - MIN_GAP
        key = Keyframe(max(low, min(high, seconds)), self.keys[index].view)
        return replace(self, keys=(*self.keys[:index], key, *self.keys[index + 1 :]))

    def stretched(self, length: float) -> "Timeline":
        """Change the length (s, limited to valid ones); keys keep their relative times."""
        needed = MIN_GAP * (len(self.keys) + 1)
        closest = min(np.diff([*(key.seconds for key in self.keys), self.length]), default=self.length)
        shortest = max(MIN_LENGTH, needed, self.length * MIN_GAP / closest if closest > 0 else 0.0)
        length = max(shortest, min(MAX_LENGTH, length))
        keys = tuple(Keyframe(key.seconds * length / self.length, key.view) for key in self.keys)
        return replace(self, keys=keys, length=length)

    def looped(self, loop: bool) -> "Timeline":
        """Switch looping on or off; a key at the very end moves ahead of the end in a loop."""
        if not (loop and self.keys and self.keys[-1].seconds > self.length - MIN_GAP):
            return replace(self, loop=loop)
        open_end = self.moved(len(self.keys) - 1, self.length - MIN_GAP)
        return replace(open_end, loop=loop)

    def converted(self, change: Callable[[Instance], Instance]) -> "Timeline":
        """Return the timeline with changed objects; the same one if none changes."""
        instances = [change(key.view.instance) for key in self.keys]
        if all(after is key.view.instance for after, key in zip(instances, self.keys, strict=True)):
            return self
        views = (key.view._replace(instance=after) for after, key in zip(instances, self.keys, strict=True))
        return replace(self, keys=tuple(map(Keyframe, (key.seconds for key in self.keys), views)))

    # Views

    def nearest(self, seconds: float) -> int | None:
        """Return the index of the key within a frame of this time, or None."""
        times = [key.seconds for key in self.keys]
        around = bisect_left(times, seconds)
        close = [index for index in (around - 1, around) if 0 <= index < len(times)]
        best = min(close, key=lambda index: abs(times[index] - seconds), default=None)
        return best if best is not None and abs(times[best] - seconds) < MIN_GAP else None

    def at(self, seconds: float) -> View:
        """Interpolate the view at a time. Raises ``ValueError`` without keys.

        Example:
            >>> from core.models.library import load_model
            >>> chair = load_model("chairs")[0]
            >>> side, front = (Camera(angle, 0.2, 1.3, 131.25, 128, 128) for angle in (0.0, 1.0))
            >>> video = Timeline((Keyframe(0.0, View(chair, side)), Keyframe(2.0, View(chair, front))), length=4.0)
            >>> video.at(2.0).camera.azimuth
            1.0
        """
        first = self._first
        seconds = seconds % self.length if self.loop else min(max(seconds, self.keys[0].seconds), self.keys[-1].seconds)
        azimuth, elevation, distance, focal = (
            _camera_row(first.camera) if self._camera is None else self._camera(seconds)
        )
        azimuth += 2 * math.pi * self.turns * seconds / self.length
        camera = replace(
            first.camera,
            azimuth=math.remainder(azimuth, 2 * math.pi),
            elevation=max(-_MAX_ELEVATION, min(_MAX_ELEVATION, float(elevation))),
            distance=math.exp(distance),
            focal=math.exp(focal) * first.camera.height,
        )
        run = next((run for run in self._runs if run.begin <= seconds), self._runs[-1])
        return View(run.at(seconds), camera)

    def frame_count(self, rate: float) -> int:
        """Return the number of frames at ``rate`` frames per second."""
        return max(1, round(self.length * rate))

    def views(self, rate: float) -> list[View]:
        """Return the views of all frames at ``rate`` per second; a loop omits the frame equal to its first."""
        count = self.frame_count(rate)
        step = self.length / count if self.loop else self.length / max(1, count - 1)
        return [self.at(index * step) for index in range(count)]

    @property
    def _first(self) -> View:
        if not self.keys:
            raise ValueError("a video needs at least one key")
        return self.keys[0].view

    @cached_property
    def _camera(self) -> "CubicHermiteSpline | None":
        """Interpolator of the camera's row over time; None for a single key."""
        if len(self.keys) == 1:
            return None
        rows = np.stack([_camera_row(key.view.camera) for key in (*self.keys, self.keys[0])])
        rows[:, 0] = np.unwrap(rows[:, 0])
        round_it = np.zeros(4)
        round_it[0] = rows[-1, 0] - rows[0, 0]
        return _path(self._times, np.concatenate([rows[:-1] + lap * round_it for lap in self._laps]))

    @cached_property
    def _runs(self) -> "list[_Run]":
        """Consecutive keys of one model, the last run first; the video cuts between runs."""
        keys = zip(self._times, [key.view.instance for _ in self._laps for key in self.keys], strict=True)
        groups = [list(group) for _, group in groupby(keys, lambda key: key[1].fingerprint)]
        return [_Run(tuple(group)) for group in reversed(groups)]

    @property
    def _laps(self) -> tuple[int, ...]:
        """Copies of the keys in time: a loop needs the previous and the next lap around it."""
        return (-1, 0, 1) if self.loop and len(self.keys) > 1 else (0,)

    @property
    def _times(self) -> Float64[np.ndarray, "knots"]:
        return np.array([key.seconds + lap * self.length for lap in self._laps for key in self.keys])


@dataclass(frozen=True, eq=False)
class _Run:
    """An object of one model over time, constant before the first knot and after the last."""

    knots: tuple[tuple[float, Instance], ...]

    @property
    def begin(self) -> float:
        """Start time, s."""
        return self.knots[0][0]

    def at(self, seconds: float) -> Instance:
        """Interpolate the object at a time, with the photo detail of the nearest knot."""
        seconds = max(self.begin, min(seconds, self.knots[-1][0]))
        nearest = min(self.knots, key=lambda knot: abs(knot[0] - seconds))[1]
        if len(self.knots) == 1:
            return nearest
        latents = {name: path(seconds) for name, path in self._paths.items()}
        return nearest.changed(edits=self._edits(seconds), **latents)

    def _edits(self, seconds: float) -> tuple[Edit, ...]:
        """Interpolate edits linearly, which passes no limit between two knots."""
        times = [time for time, _ in self.knots]
        last = min(bisect_right(times, seconds), len(times) - 1)
        first, second = (instance.codes.edits for _, instance in self.knots[last - 1 : last + 1])
        amount = float((seconds - times[last - 1]) / (times[last] - times[last - 1]))
        return kinds.mixed(first, second, amount, amount)

    @cached_property
    def _paths(self) -> dict[str, Callable[[float], Tensor]]:
        """Shape, texture and offsets over time, by field; without offsets that no knot has."""
        times = np.array([time for time, _ in self.knots])
        paths = dict[str, Callable[[float], Tensor]]()
        for name in (field.name for field in fields(Latents)):
            tensors = [getattr(instance.codes, name) for _, instance in self.knots]
            template = next((tensor for tensor in tensors if tensor is not None), None)
            if template is not None:
                paths[name] = _tensor_path(times, tensors, template)
        return paths


def _tensor_path(
    times: Float64[np.ndarray, "knots"], tensors: Sequence[Tensor | None], template: Tensor
) -> Callable[[float], Tensor]:
    """Interpolate tensors over time; None stands for zeros like the template."""
    filled = (torch.zeros_like(template) if tensor is None else tensor for tensor in tensors)
    spline = _path(times, np.stack([tensor.double().cpu().flatten().numpy() for tensor in filled]))
    return lambda seconds: torch.from_numpy(spline(seconds)).to(template.dtype).reshape(template.shape)


def _path(times: Float64[np.ndarray, "knots"], rows: Float64[np.ndarray, "knots numbers"]) -> "CubicHermiteSpline":
    """Interpolate rows by Catmull-Rom splines."""
    from scipy.interpolate import CubicHermiteSpline  # imports in 0.3 s; a turn does not need it

    slopes = np.zeros_like(rows)
    slopes[1:-1] = (rows[2:] - rows[:-2]) / (times[2:] - times[:-2])[:, None]
    return CubicHermiteSpline(times, rows, slopes)


def turntable(instance: Instance, camera: Camera, frames: int = TURN) -> list[View]:
    """Return the views of one full turn around the object, at the camera's elevation and distance."""
    return _round(instance, camera, frames, lambda phase: phase)


def swing(instance: Instance, camera: Camera, frames: int = SWING) -> list[View]:
    """Return the views of a swing by 70 degrees to both sides of the camera, slow at either end; a loop has no seam."""
    return _round(instance, camera, frames, lambda phase: _SWING_ANGLE * math.sin(phase))


def morph(first: Instance, second: Instance, camera: Camera, frames: int = TURN) -> list[View]:
    """Return the views of one full turn in which the object becomes another one and itself again."""
    keys = Keyframe(0.0, View(first, camera)), Keyframe(0.5, View(second, camera))
    return Timeline(keys, 1.0, turns=1).views(frames)  # lasts a second, so the rate is the number of frames


def _round(instance: Instance, camera: Camera, frames: int, angle: Callable[[float], float]) -> list[View]:
    """Return views at an angle (rad) beside the camera, as a function of the phase (rad, 0 to 2 pi)."""
    if frames < 1:
        raise ValueError(f"a film around an object needs at least 1 frame, got {frames}")
    angles = (camera.azimuth + angle(2 * math.pi * index / frames) for index in range(frames))
    return [View(instance, replace(camera, azimuth=azimuth)) for azimuth in angles]


def _camera_row(camera: Camera) -> Float64[np.ndarray, "4"]:
    """Return a camera as numbers to interpolate: angles, logarithms of distance and focal length."""
    logs = math.log(camera.distance), math.log(camera.focal / camera.height)
    return np.array((camera.azimuth, camera.elevation, *logs))
