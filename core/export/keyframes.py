"""Keyframes in time, and the views between them: the camera goes along the sphere, codes from one to the next.

Between objects of two models the video cuts.
"""

import math
from bisect import bisect_left
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
import torch
from jaxtyping import Float64

from core.geometry.camera import Camera
from core.models.codes import Codes

if TYPE_CHECKING:
    from scipy.interpolate import BSpline, CubicHermiteSpline

    _Path: TypeAlias = BSpline | CubicHermiteSpline

MIN_GAP = 0.04  # s between two keys at the least: one frame
MIN_LENGTH, MAX_LENGTH = 0.2, 600.0  # s
_MAX_ELEVATION = math.radians(89.0)  # Short of the pole, which a smooth path may overshoot.


class View(NamedTuple):
    """An object from a camera."""

    codes: Codes
    camera: Camera


class Keyframe(NamedTuple):
    """A view at its time."""

    seconds: float
    view: View


@dataclass(frozen=True)
class Timeline:
    """A video described by keyframes. Raises ``ValueError`` where keys are out of order, out of time or too close."""

    keys: tuple[Keyframe, ...] = ()
    length: float = 4.0  # s
    loop: bool = True
    """after the last keyframe it continues to the first, which it meets at the end; else it rests on the last"""
    turns: int = 0  # of the camera around the object in the whole video, besides what the keys do
    smooth: bool = True  # Catmull-Rom through the keys, for cameras and codes; else straight from key to key

    def __post_init__(self) -> None:
        if not MIN_LENGTH <= self.length <= MAX_LENGTH:
            raise ValueError(f"a video takes {MIN_LENGTH:g} to {MAX_LENGTH:g} s, got {self.length:g}")
        times = [key.seconds for key in self.keys]
        # In a loop the end is the beginning: a key there would be a second one at the same time.
        last = self.length - (MIN_GAP if self.loop else 0.0)
        if times and (times[0] < 0 or times[-1] > last + 1e-6 or min(np.diff(times), default=MIN_GAP) < MIN_GAP - 1e-6):
            raise ValueError(f"keys must be {MIN_GAP:g} s apart within the video, got {times}")

    # Edits: each is a new timeline

    def added(self, seconds: float, view: View) -> "Timeline":
        """With a key more; keys too close to it go."""
        seconds = max(0.0, min(seconds, self.length - (MIN_GAP if self.loop else 0.0)))
        left = [key for key in self.keys if abs(key.seconds - seconds) >= MIN_GAP]
        return replace(self, keys=tuple(sorted((*left, Keyframe(seconds, view)), key=lambda key: key.seconds)))

    def replaced(self, index: int, view: View) -> "Timeline":
        """With another view at the time of a key."""
        key = Keyframe(self.keys[index].seconds, view)
        return replace(self, keys=(*self.keys[:index], key, *self.keys[index + 1 :]))

    def removed(self, index: int) -> "Timeline":
        """Without a key."""
        return replace(self, keys=(*self.keys[:index], *self.keys[index + 1 :]))

    def moved(self, index: int, seconds: float) -> "Timeline":
        """With a key at another time, no further than to its neighbours."""
        low = self.keys[index - 1].seconds + MIN_GAP if index else 0.0
        high = self.length - (MIN_GAP if self.loop else 0.0)
        if index + 1 < len(self.keys):
            high = self.keys[index + 1].seconds - MIN_GAP
        key = Keyframe(max(low, min(high, seconds)), self.keys[index].view)
        return replace(self, keys=(*self.keys[:index], key, *self.keys[index + 1 :]))

    def stretched(self, length: float) -> "Timeline":
        """In another time (s, kept to what a video can take), the keys at the same shares of it."""
        needed = MIN_GAP * (len(self.keys) + 1)
        closest = min(np.diff([*(key.seconds for key in self.keys), self.length]), default=self.length)
        shortest = max(MIN_LENGTH, needed, self.length * MIN_GAP / closest if closest > 0 else 0.0)
        length = max(shortest, min(MAX_LENGTH, length))
        keys = tuple(Keyframe(key.seconds * length / self.length, key.view) for key in self.keys)
        return replace(self, keys=keys, length=length)

    def looped(self, loop: bool) -> "Timeline":
        """As a loop, or not; a key at the end stays short of it in a loop."""
        if not (loop and self.keys and self.keys[-1].seconds > self.length - MIN_GAP):
            return replace(self, loop=loop)
        open_end = self.moved(len(self.keys) - 1, self.length - MIN_GAP)
        return replace(open_end, loop=loop)

    # What is shown

    def nearest(self, seconds: float) -> int | None:
        """The key at this time, if there is one within a frame."""
        times = [key.seconds for key in self.keys]
        around = bisect_left(times, seconds)
        close = [index for index in (around - 1, around) if 0 <= index < len(times)]
        best = min(close, key=lambda index: abs(times[index] - seconds), default=None)
        return best if best is not None and abs(times[best] - seconds) < MIN_GAP else None

    def at(self, seconds: float) -> View:
        """The view at a time. Raises ``ValueError`` without keys.

        Example:
            >>> codes = Codes(torch.zeros(2), torch.ones(3))
            >>> side, front = (Camera(angle, 0.2, 1.3, 131.25, 128, 128) for angle in (0.0, 1.0))
            >>> video = Timeline((Keyframe(0.0, View(codes, side)), Keyframe(2.0, View(codes, front))), length=4.0)
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
        """The number of frames at so many a second."""
        return max(1, round(self.length * rate))

    def views(self, rate: float) -> list[View]:
        """The views of all frames at so many a second; a loop ends one frame before its beginning."""
        count = self.frame_count(rate)
        step = self.length / count if self.loop else self.length / max(1, count - 1)
        return [self.at(index * step) for index in range(count)]

    def loop_error(self, rate: float = 24.0) -> float:
        """The step from the last frame back to the first, relative to the longest step between any others.

        Cameras are compared by position and codes by value; at most about 1 where a loop has no jump.
        """
        several = len({key.view.codes.model for key in self.keys}) > 1  # a cut is no jump, and codes cannot be compared
        rows = np.stack([_comparable_row(view, with_codes=not several) for view in self.views(rate)])
        longest = np.linalg.norm(np.diff(rows, axis=0), axis=1).max(initial=0.0)
        return float(np.linalg.norm(rows[0] - rows[-1]) / max(longest, 1e-9))

    @property
    def _first(self) -> View:
        if not self.keys:
            raise ValueError("a video needs at least one key")
        return self.keys[0].view

    @cached_property
    def _camera(self) -> "_Path | None":
        """The camera's row by the time; None where one key has it for all times."""
        if len(self.keys) == 1:
            return None
        rows = np.stack([_camera_row(key.view.camera) for key in (*self.keys, self.keys[0])])
        rows[:, 0] = np.unwrap(rows[:, 0])
        round_it = np.zeros(4)
        round_it[0] = rows[-1, 0] - rows[0, 0]
        return _path(self._times, np.concatenate([rows[:-1] + lap * round_it for lap in self._laps]), self.smooth)

    @cached_property
    def _runs(self) -> "list[_Run]":
        """Keys of one model that follow each other, the last ones first: from one run to the next it cuts."""
        keys = zip(self._times, [key.view.codes for _ in self._laps for key in self.keys], strict=True)
        groups = [list(group) for _, group in groupby(keys, lambda key: key[1].model)]
        return [_Run(tuple(group), self.smooth) for group in reversed(groups)]

    @property
    def _laps(self) -> tuple[int, ...]:
        """A loop is what it is between the lap before and the next."""
        return (-1, 0, 1) if self.loop and len(self.keys) > 1 else (0,)

    @property
    def _times(self) -> Float64[np.ndarray, "knots"]:
        return np.array([key.seconds + lap * self.length for lap in self._laps for key in self.keys])


@dataclass(frozen=True, eq=False)
class _Run:
    """Codes of one model in time; before the first and after the last they rest."""

    knots: tuple[tuple[float, Codes], ...]
    smooth: bool

    @property
    def begin(self) -> float:
        """s"""
        return self.knots[0][0]

    def at(self, seconds: float) -> Codes:
        """The codes at a time, with the photo's detail of the nearest knot."""
        seconds = max(self.begin, min(seconds, self.knots[-1][0]))
        nearest = min(self.knots, key=lambda knot: abs(knot[0] - seconds))[1]
        if self._path is None:
            return nearest
        numbers, shape = torch.from_numpy(self._path(seconds)).float(), len(nearest.shape)
        return replace(nearest, shape=numbers[:shape], texture=numbers[shape:])

    @cached_property
    def _path(self) -> "_Path | None":
        if len(self.knots) == 1:
            return None
        times, rows = [knot[0] for knot in self.knots], [_codes_row(knot[1]) for knot in self.knots]
        return _path(np.array(times), np.stack(rows), self.smooth)


def _path(times: Float64[np.ndarray, "knots"], rows: Float64[np.ndarray, "knots numbers"], smooth: bool) -> "_Path":
    """Catmull-Rom through rows, or straight from one to the next."""
    from scipy.interpolate import CubicHermiteSpline, make_interp_spline  # a third of a second: a turn needs none

    if not smooth:
        return make_interp_spline(times, rows, k=1)
    slopes = np.zeros_like(rows)
    slopes[1:-1] = (rows[2:] - rows[:-2]) / (times[2:] - times[:-2])[:, None]
    return CubicHermiteSpline(times, rows, slopes)


def turntable(codes: Codes, camera: Camera, frames: int = 72) -> list[View]:
    """One turn around the object, from the camera's azimuth and at its elevation and distance."""
    if frames < 1:
        raise ValueError(f"a turntable needs at least 1 frame, got {frames}")
    angles = (camera.azimuth + 2 * math.pi * index / frames for index in range(frames))
    return [View(codes, replace(camera, azimuth=angle)) for angle in angles]


def _camera_row(camera: Camera) -> Float64[np.ndarray, "4"]:
    """A camera as numbers between which one can go straight: angles, logarithms of distance and focal length."""
    logs = math.log(camera.distance), math.log(camera.focal / camera.height)
    return np.array((camera.azimuth, camera.elevation, *logs))


def _codes_row(codes: Codes) -> Float64[np.ndarray, "numbers"]:
    return np.concatenate([code.double().cpu().numpy() for code in (codes.shape, codes.texture)])


def _comparable_row(view: View, with_codes: bool) -> Float64[np.ndarray, "numbers"]:
    """A view as numbers that are close where its renders are: the azimuth as a point on the circle."""
    row = _camera_row(view.camera)
    place = np.array([math.cos(row[0]), math.sin(row[0]), *row[1:]])
    return np.concatenate([place, _codes_row(view.codes)]) if with_codes else place
