"""The object of a video, cut out of the frames that show all of it."""

from collections.abc import Generator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from PIL import Image

from core.geometry.pixels import bounding_box
from core.models.model import Model
from core.photos.clip import FRAMES, read_clip
from core.photos.photo import DOUBTFUL_MASK, Photo, naming, prepare_photo
from core.photos.segmentation import CutOut, cut_out
from core.streams import run_to_end, subprogress

_READING = 0.5  # fraction of the time; the rest is cutting out


class FrameCut(NamedTuple):
    """A frame of a video and its cut-out."""

    name: str  # the file and the time, for messages
    image: Image.Image  # RGBA
    cut: CutOut


class ClipCuts(NamedTuple):
    """The cut-outs of a video, in order of time."""

    frames: tuple[FrameCut, ...]  # at least one
    note: str  # frames that were left out; empty for none


def load_clip(path: Path | str, model: Model, count: int = FRAMES) -> tuple[Photo, ...]:
    """Read a video of a walk around an object as photos, cut out and cropped for a model.

    The photos are the sharpest frames at ``count`` even steps of time, without those that truncate the object.

    Raises ``ValueError`` naming the file if it cannot be read, or no frame shows a whole object.
    """
    photos = []
    for name, _, cut in run_to_end(cut_out_clip(Path(path), count)).frames:
        with naming(name):
            photos.append(prepare_photo(cut, model))
    return tuple(photos)


def cut_out_clip(path: Path, count: int = FRAMES) -> Generator[float, None, ClipCuts]:
    """Cut out the object of a video; yield the finished fraction, 0..1.

    Frames without an object or with a truncated one are left out, and those with a doubtful mask or without a chair or
    a car if most frames are better. All frames get the mean of their category probabilities: they show one object.

    Raises ``ValueError`` naming the file if it cannot be read, or no frame shows a whole object.
    """
    frames = yield from subprogress(read_clip(path, count), 0.0, _READING)
    candidates = list[FrameCut]()
    reasons = list[str]()
    for number, (image, seconds) in enumerate(frames, 1):
        try:
            cut = cut_out(image)
        except ValueError:
            reasons.append(f"no object at {seconds:.1f} s")
        else:
            if _is_truncated(cut):
                reasons.append(f"the object is cut off at {seconds:.1f} s")
            else:
                candidates.append(FrameCut(f"{path.name} at {seconds:.1f} s", image, cut))
        yield _READING + (1 - _READING) * number / len(frames)
    if not candidates:
        raise ValueError(f"{path}: no frame shows a whole object ({', '.join(reasons)})")
    doubtful = [frame for frame in candidates if not _is_clear(frame.cut)]
    if 2 * len(doubtful) <= len(candidates):
        reasons += [f"a doubtful cut-out{frame.name.removeprefix(path.name)}" for frame in doubtful]
        candidates = [frame for frame in candidates if frame not in doubtful]
    note = f"{len(reasons)} of {len(frames)} frames are left out: {', '.join(reasons)}" if reasons else ""
    return ClipCuts(tuple(_with_mean_categories(candidates)), note)


def _is_truncated(cut: CutOut) -> bool:
    """True if the object touches an edge of the frame."""
    left, top, right, bottom = bounding_box(cut.mask)
    height, width = cut.mask.shape
    return left == 0 or top == 0 or right == width or bottom == height


def _is_clear(cut: CutOut) -> bool:
    """True for a sure mask of a detected object, or before a plain background, where detectors may see none."""
    return cut.confidence >= DOUBTFUL_MASK and bool(cut.detections or cut.confidence == 1)


def _with_mean_categories(frames: Sequence[FrameCut]) -> list[FrameCut]:
    guesses = [frame.cut.categories for frame in frames if frame.cut.categories]
    mean = {name: sum(guess[name] for guess in guesses) / len(guesses) for name in (guesses[0] if guesses else ())}
    return [frame._replace(cut=replace(frame.cut, categories=dict(mean))) for frame in frames]
