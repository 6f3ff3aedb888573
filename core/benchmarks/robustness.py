"""The atlas of where fits fail: pictures made worse in one way at a time, fitted blind.

Objects of the model itself, so that nothing but the stressor is wrong with a picture. A worsened picture takes the
same way into a fit as a person's: it is cut out by its alpha channel, or by its ground where that is missing.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from PIL import Image
from scipy.ndimage import binary_dilation, binary_erosion, gaussian_filter

from core.benchmarks.held_out_views import anywhere, drawn_on_white, looks_alike, spread_objects
from core.benchmarks.rendering import machine
from core.fitting.confidence import DOUBTFUL
from core.fitting.fit import PRESETS, FitJob, FitSettings, Hypothesis, fit
from core.fitting.settings import PaperSettings
from core.geometry.camera import Camera
from core.metrics import rotation_error
from core.models.codes import Codes
from core.models.library import load_model, shipped_models
from core.models.model import Model
from core.photos.photo import photo_from_array

COMPARED = {name: PRESETS[name] for name in ("normal", "paper")}
SUCCESS_DEGREES = 5.0
_BASIN = 25.0
"""degrees that a camera may be off the truth, or a twin off its half turn, to be called near it"""

Cutout = Float[np.ndarray, "height width 4"]
"""0..1: colours on white, and alpha"""


class Stressor(NamedTuple):
    """One way in which a picture can be worse."""

    unit: str
    levels: tuple[float, ...]
    worsened: Callable[[Cutout, float, np.random.Generator], np.ndarray] = lambda cutout, *_: cutout
    """a picture with 3 or 4 channels"""
    viewed: Callable[[Camera, float], Camera] = lambda camera, _: camera
    """the camera that it is drawn from"""
    begun: Callable[[Camera, float], Camera] | None = None
    """from the true camera, where the paper's recipe is told to begin; ours is never told"""
    absent: bool = False
    """It shows nothing that the model knows: to be refused, or doubted."""
    other: bool = False
    """It shows an object of another shipped category."""


@dataclass(frozen=True)
class Trial:
    """One fit of one worsened picture."""

    stressor: str
    level: float
    preset: str
    name: str
    rotation: float | None
    """degrees; None where the picture was refused"""
    confidence: float | None
    ended: str
    """"right", "symmetric", "near", "twin", "elsewhere", or why the picture was refused; where there is nothing to be
    found it is "refused", "doubted" or "believed"."""
    seen: tuple[np.ndarray, np.ndarray | None] | None = None
    """of a failure: the picture, and what was found in it; (height, width, 3), uint8"""

    @property
    def success(self) -> bool:
        """The camera was found to 5 degrees, or another from which the object looks the same; or nothing was believed
        to be seen where there is nothing.
        """
        return self.ended in ("right", "symmetric", "refused", "doubted")

    def told(self) -> dict:
        """As plain values."""
        return {name: value for name, value in vars(self).items() if name != "seen"}


@dataclass(frozen=True)
class Atlas:
    """Everything that one run found."""

    machine: str
    objects: int
    trials: tuple[Trial, ...]

    def told(self) -> dict:
        """As plain values, the failures once more by themselves."""
        trials = [trial.told() for trial in self.trials]
        failures = [trial.told() for trial in self.trials if not trial.success]
        return {"machine": self.machine, "objects": self.objects, "trials": trials, "failures": failures}

    def cells(self) -> dict[tuple[str, float], dict[str, float]]:
        """The share of successes of every preset, by stressor and level."""
        cells: dict[tuple[str, float], dict[str, list[bool]]] = {}
        for trial in self.trials:
            cells.setdefault((trial.stressor, trial.level), {}).setdefault(trial.preset, []).append(trial.success)
        return {cell: {name: sum(all_) / len(all_) for name, all_ in found.items()} for cell, found in cells.items()}


def measured(
    model: Model, objects: int = 2, seed: int = 0, presets: dict[str, FitSettings] = COMPARED
) -> Iterator[str | Atlas]:
    """What is being measured now, and in the end the atlas. To stop, ask for no more."""
    generator = torch.Generator().manual_seed(seed)
    seen = [(name, codes, anywhere(model, generator)) for name, codes in spread_objects(model, objects)]
    trials = list[Trial]()
    for what, stressor in STRESSORS.items():
        for level in stressor.levels:
            yield f"{what} {level:g} {stressor.unit}"
            for number, (name, codes, camera) in enumerate(seen):
                truth = stressor.viewed(camera, level)
                picture = _picture(model, codes, truth, stressor, level, seed + number)
                for preset, settings in presets.items():
                    trial = Trial(what, level, preset, name, None, None, "")
                    begin = (
                        stressor.begun(truth, level) if stressor.begun and isinstance(settings, PaperSettings) else None
                    )
                    job = _Job(picture, settings, seed + number, begin)
                    trials.append(_tried(model, codes, job, truth, trial, stressor.absent))
    yield Atlas(machine(model.device), len(seen), tuple(trials))


def _picture(model: Model, codes: Codes, camera: Camera, stressor: Stressor, level: float, seed: int) -> np.ndarray:
    if stressor.other:
        model = load_model(next(name for name in shipped_models() if name != model.category), model.device.type)
        codes, camera = model.codes[seed % len(model.codes.objects)], model.camera(camera.azimuth, camera.elevation)
    colour, mask = drawn_on_white(model, codes, camera)
    cutout = np.concatenate((colour.numpy(), mask[..., None].numpy().astype(np.float32)), -1)
    return stressor.worsened(cutout, level, np.random.default_rng(seed))


class _Job(NamedTuple):
    """A fit of a worsened picture."""

    picture: np.ndarray
    settings: FitSettings
    seed: int
    begin: Camera | None

    def for_model(self, model: Model) -> FitJob:
        """With the mean codes, where it is told where to begin."""
        photo, begin = photo_from_array(self.picture, model), None
        if self.begin:
            begin = Hypothesis(0, math.inf, (self.begin,), model.codes.mean, torch.zeros(1, 2))
        return FitJob((photo,), self.settings, self.seed, begin)


def _tried(model: Model, codes: Codes, job: _Job, truth: Camera, trial: Trial, absent: bool) -> Trial:
    """The trial with what came of it."""
    picture = job.picture
    before = (255 * picture[..., :3] + 0.5).astype(np.uint8) if picture.dtype != np.uint8 else picture[..., :3]
    try:
        *_, last = fit(model, job.for_model(model))
    except ValueError as error:
        return replace(trial, ended="refused" if absent else str(error), seen=None if absent else (before, None))
    off: float | None = None
    if absent:
        kind = "doubted" if last.confidence is not None and last.confidence < DOUBTFUL else "believed"
    else:
        off = rotation_error(last.cameras[0], truth)
        kind = _kind(last.cameras[0], truth, off)
    if kind in ("twin", "elsewhere") and looks_alike(model, codes, last.cameras[0], truth, SUCCESS_DEGREES):
        kind = "symmetric"
    trial = replace(trial, rotation=off, confidence=last.confidence, ended=kind)
    if trial.success:
        return trial
    found = drawn_on_white(model, last.codes, last.cameras[0])[0]
    return replace(trial, seen=(before, (255 * found + 0.5).byte().numpy()))


def _kind(found: Camera, truth: Camera, off: float) -> str:
    if off <= SUCCESS_DEGREES:
        return "right"
    if off <= _BASIN:
        return "near"
    turn = math.degrees(found.azimuth - truth.azimuth) % 360
    tilt = abs(math.degrees(found.elevation - truth.elevation))
    return "twin" if abs(turn - 180) < _BASIN and tilt < _BASIN else "elsewhere"


# Ways to worsen a picture


def _occluded(cutout: Cutout, share: float, _: np.random.Generator) -> np.ndarray:
    """Something of the ground's colour stands before the object's left part."""
    columns = (cutout[..., 3] > 0.5).sum(0).cumsum()
    hidden = columns <= share * columns[-1]
    worse = cutout.copy()
    worse[:, hidden] = (1, 1, 1, 0)
    return worse


def _moved(cutout: Cutout, share: float, _: np.random.Generator) -> np.ndarray:
    """To the right and down, as far as the picture goes."""
    side = round((1 - share) * len(cutout))
    moved = np.zeros_like(cutout)
    moved[..., :3] = 1
    moved[-side:, -side:] = cutout[:side, :side]
    return moved


def _blurred(cutout: Cutout, pixels: float, _: np.random.Generator) -> np.ndarray:
    return gaussian_filter(cutout, (pixels, pixels, 0), mode="nearest")


def _noisy(cutout: Cutout, spread: float, numbers: np.random.Generator) -> np.ndarray:
    worse = cutout.copy()
    worse[..., :3] += spread * numbers.normal(size=worse[..., :3].shape)
    return worse.clip(0, 1)


def _exposed(cutout: Cutout, factor: float, _: np.random.Generator) -> np.ndarray:
    lit = np.where(cutout[..., 3:] > 0.5, cutout[..., :3] * factor, 1)
    return np.concatenate((lit, cutout[..., 3:]), -1).clip(0, 1)


def _shrunk(cutout: Cutout, side: float, _: np.random.Generator) -> np.ndarray:
    image = Image.fromarray((cutout * 255 + 0.5).astype(np.uint8), "RGBA")
    return np.asarray(image.resize((int(side), int(side)), Image.Resampling.BOX))


def _masked_wrongly(cutout: Cutout, pixels: float, _: np.random.Generator) -> np.ndarray:
    """The mask eroded (negative) or dilated, the picture as it is."""
    grown = (binary_dilation if pixels > 0 else binary_erosion)(cutout[..., 3] > 0.5, iterations=round(abs(pixels)))
    colours = np.where(grown[..., None], cutout[..., :3], 1)
    return np.concatenate((colours, grown[..., None].astype(np.float32)), -1)


def _unmasked(cutout: Cutout, grey: float, _: np.random.Generator) -> np.ndarray:
    """On a plain ground, without an alpha channel."""
    return np.where(cutout[..., 3:] > 0.5, cutout[..., :3], np.float32(grey))


def _cropped(cutout: Cutout, share: float, _: np.random.Generator) -> np.ndarray:
    """The object's left part lies outside the picture."""
    columns = (cutout[..., 3] > 0.5).sum(0).cumsum()
    return cutout[:, columns > share * columns[-1]]


def _tinted(cutout: Cutout, factor: float, _: np.random.Generator) -> np.ndarray:
    """The object under warmer light, or colder (below 1)."""
    lit = np.where(cutout[..., 3:] > 0.5, cutout[..., :3] * np.array((factor, 1, 1 / factor), np.float32), 1)
    return np.concatenate((lit, cutout[..., 3:]), -1).clip(0, 1)


def _faded(cutout: Cutout, share: float, _: np.random.Generator) -> np.ndarray:
    """Colours nearer to the object's mean, so that there is less and less texture."""
    mask = cutout[..., 3:] > 0.5
    mean = cutout[mask[..., 0], :3].mean(0)
    return np.concatenate((np.where(mask, cutout[..., :3] * (1 - share) + mean * share, 1), cutout[..., 3:]), -1)


def _plain(cutout: Cutout, grey: float, _: np.random.Generator) -> np.ndarray:
    return np.full_like(cutout[..., :3], grey)


def _random(cutout: Cutout, _: float, numbers: np.random.Generator) -> np.ndarray:
    return numbers.random(cutout[..., :3].shape, np.float32)


STRESSORS = {
    "nothing": Stressor("", (0.0,)),
    "initial error": Stressor(
        "degrees around; ours is told no start",
        (0.0, 15.0, 45.0, 90.0, 180.0),
        begun=lambda camera, level: replace(camera, azimuth=camera.azimuth + math.radians(level)),
    ),
    "elevation": Stressor(
        "degrees", (0.0, 30.0, 60.0, 89.0), viewed=lambda camera, level: replace(camera, elevation=math.radians(level))
    ),
    "occlusion": Stressor("of the object", (0.1, 0.3, 0.5), _occluded),
    "cropping": Stressor("of the object", (0.1, 0.3), _cropped),
    "off centre": Stressor("of the picture", (0.1, 0.3), _moved),
    "focal length": Stressor(
        "times, from as much further away",
        (0.7, 1.3),
        viewed=lambda camera, level: replace(camera, focal=level * camera.focal, distance=level * camera.distance),
    ),
    "input size": Stressor("px", (64.0, 32.0, 16.0), _shrunk),
    "blur": Stressor("px", (1.0, 3.0), _blurred),
    "noise": Stressor("of white", (0.05, 0.2), _noisy),
    "exposure": Stressor("times", (0.5, 0.75, 1.5), _exposed),
    "white balance": Stressor("times red, and as much less blue", (0.8, 1.25), _tinted),
    "faded texture": Stressor("of the colours", (0.5, 1.0), _faded),
    "mask": Stressor("px too wide", (-2.0, 2.0, 4.0), _masked_wrongly),
    "no mask": Stressor("grey level", (1.0, 0.5), _unmasked),
    "plain picture": Stressor("grey level", (0.0, 1.0), _plain, absent=True),
    "random pixels": Stressor("", (0.0,), _random, absent=True),
    "another category": Stressor("", (0.0,), absent=True, other=True),
}
"""By name; every level of each is tried on every object."""
