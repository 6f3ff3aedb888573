"""The atlas of where fits fail: pictures made worse in one way at a time, fitted blind.

Objects of the model itself, so that nothing but the stressor is wrong with a picture. A worsened picture takes the
same way into a fit as a person's: it is cut out by its alpha channel, or by its ground where that is missing.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from PIL import Image
from scipy.ndimage import binary_dilation, binary_erosion, gaussian_filter

from core.bench.rendering import machine
from core.bench.subjects import anywhere, drawn_on_white, looks_alike, spread_objects
from core.camera import Camera
from core.codes import Codes
from core.fit import PRESETS, FitJob, FitSettings, fit
from core.metrics import rotation_error
from core.model import Model
from core.photos import photo_from_array

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
    worsened: Callable[[Cutout, float, np.random.Generator], np.ndarray] | None = None
    """a picture with 3 or 4 channels; None where it is the camera that is stressed"""


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
    """"right", "symmetric", "near", "twin", "elsewhere", or why the picture was refused"""

    @property
    def success(self) -> bool:
        """The camera was found to 5 degrees, or another from which the object looks the same."""
        return self.ended in ("right", "symmetric")


@dataclass(frozen=True)
class Atlas:
    """Everything that one run found."""

    machine: str
    objects: int
    trials: tuple[Trial, ...]

    def told(self) -> dict:
        """As plain values, the failures once more by themselves."""
        return {**asdict(self), "failures": [asdict(trial) for trial in self.trials if not trial.success]}

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
                truth = camera if stressor.worsened else model.camera(camera.azimuth, math.radians(level))
                picture = _picture(model, codes, truth, stressor, level, seed + number)
                for preset, settings in presets.items():
                    ended = _ended(model, codes, picture, truth, settings, seed + number)
                    trials.append(Trial(what, level, preset, name, *ended))
    yield Atlas(machine(), len(seen), tuple(trials))


def _picture(model: Model, codes: Codes, camera: Camera, stressor: Stressor, level: float, seed: int) -> np.ndarray:
    colour, mask = drawn_on_white(model, codes, camera)
    cutout = np.concatenate((colour.numpy(), mask[..., None].numpy().astype(np.float32)), -1)
    return stressor.worsened(cutout, level, np.random.default_rng(seed)) if stressor.worsened else cutout


def _ended(
    model: Model, codes: Codes, picture: np.ndarray, truth: Camera, settings: FitSettings, seed: int
) -> tuple[float | None, float | None, str]:
    """Rotation error, confidence, and how the fit ended."""
    try:
        *_, last = fit(model, FitJob((photo_from_array(picture, model),), settings, seed))
    except ValueError as error:
        return None, None, str(error)
    off = rotation_error(last.cameras[0], truth)
    kind = _kind(last.cameras[0], truth, off)
    if kind in ("twin", "elsewhere") and looks_alike(model, codes, last.cameras[0], truth, SUCCESS_DEGREES):
        kind = "symmetric"
    return off, last.confidence, kind


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
    """To the right and down, in a picture that is large enough to hold it."""
    pad = round(share * len(cutout))
    whole = np.pad(1 - cutout[..., :3], ((pad, 0), (pad, 0), (0, 0)))
    return np.concatenate((1 - whole, np.pad(cutout[..., 3:], ((pad, 0), (pad, 0), (0, 0)))), -1)


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


STRESSORS = {
    "nothing": Stressor("", (0.0,), lambda cutout, *_: cutout),
    "elevation": Stressor("degrees", (0.0, 30.0, 60.0, 85.0)),
    "occlusion": Stressor("of the object", (0.1, 0.3, 0.5), _occluded),
    "off centre": Stressor("of the picture", (0.1, 0.3), _moved),
    "blur": Stressor("px", (1.0, 3.0), _blurred),
    "noise": Stressor("of white", (0.05, 0.2), _noisy),
    "exposure": Stressor("times", (0.5, 0.75, 1.5), _exposed),
    "input size": Stressor("px", (64.0, 32.0, 16.0), _shrunk),
    "mask": Stressor("px too wide", (-2.0, 2.0, 4.0), _masked_wrongly),
    "no mask": Stressor("grey level", (1.0, 0.5), _unmasked),
}
"""By name; every level of each is tried on every object."""
