"""``fit``: estimate a camera and codes from images."""

import argparse
import io
import json
import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from itertools import repeat
from pathlib import Path
from typing import NamedTuple

from PIL import Image
from tqdm import tqdm

from core.classifiers.viewpoint import SIDES, Side
from core.cli.explain import draw_detections, write_page
from core.cli.output import LastingOutput, bars_disabled, say
from core.cli.progress import run_with_fraction, wait_for_view_bank
from core.fitting.category_check import describe_ambiguity, describe_category, describe_difference, likeliest_model
from core.fitting.confidence import DOUBTFUL
from core.fitting.fit import PRESETS, FitJob, FitStep
from core.fitting.paper import fit_as_set
from core.fitting.photo_views import resume_point
from core.fitting.problem import MOST_PHOTOS
from core.geometry.camera import Camera
from core.geometry.pose_files import PosedImage, find_pose, require_scale
from core.models.library import load_model, model_with
from core.models.model import Model
from core.models.scene import Scene, scene_model
from core.photos.clip import FRAMES, is_clip
from core.photos.clip_object import cut_out_clip
from core.photos.decode import NOTE, image_files, read_mask, read_rgba, upright_size
from core.photos.photo import DOUBTFUL_MASK, Photo, naming, prepare_photo
from core.photos.plain_background import NoBackgroundError
from core.photos.segmentation import CutOut, Hints, cut_out
from core.runtime.files import open_output, require_writable, save_or_elsewhere

_AS_PROMINENT = 0.7  # fraction of the first object's prominence from which a second object is mentioned
Seconds = dict[str, float]  # of a fit, by stage


class Fitted(NamedTuple):
    """The result of one fit."""

    model: Model
    names: Sequence[Path | str]  # of the photos
    photos: tuple[Photo, ...]
    cuts: tuple[CutOut, ...]  # one per photo, without those kept with a resumed object
    last: FitStep
    image: Image.Image  # the first photo, whole
    seconds: Seconds


class _Input(NamedTuple):
    """A photo, or a frame of a video, to be fitted."""

    name: Path | str  # the file; of a frame, also its time
    image: Image.Image  # RGBA
    cut: CutOut
    posed: PosedImage | None = None  # the known camera
    side: Side | None = None  # that a person names


def fit(args: argparse.Namespace) -> None:
    """Run ``fit``: estimate camera and codes of the object in the images; end with a line of JSON."""
    _split_sides(args)
    check_counts(args)
    _check_files(args)
    fitted = fit_images(args)
    try:
        if args.out:
            save_or_elsewhere(fitted_scene(args, fitted.last).save, args.out)
        if args.explain:
            detections = draw_detections(fitted.image, fitted.cuts[0])
            write_page(fitted.model, fitted.photos[0], fitted.last, detections, args.explain)
    finally:  # files first, because the output may have no reader; printed even if a file fails
        say_doubts(fitted)
        print(json.dumps(to_dict(args, fitted)), flush=True)


def fit_images(args: argparse.Namespace) -> Fitted:
    """Fit the object in the chosen images, under progress bars."""
    seconds: Seconds = {}
    settings = replace(PRESETS[args.preset], estimate_focal=args.estimate_focal)
    inputs = list(_read_inputs(args, seconds))
    _compare_categories(args, inputs)
    cuts = tuple(source.cut for source in inputs)
    name = args.model or likeliest_model(cuts[0].categories)
    model = load_model(model_with(args.resume and scene_model(args.resume), name), args.device)
    earlier, hypothesis = resume_point(Scene.load(args.resume, model).instance) if args.resume else ((), None)
    with _timed(seconds, "view_bank"):
        wait_for_view_bank(model)
    photos = *earlier, *map(_photo, inputs, repeat(model), repeat(args.pose_scale))
    guess = cuts[0].categories
    if warning := describe_category(guess, model.category) or ("" if args.model else describe_ambiguity(guess)):
        say(warning)
    with _timed(seconds, "search"):
        last = _search(model, FitJob(photos, settings, args.seed, hypothesis), args.log)
    names = [
        *(f"photo {number} of {args.resume}" for number in range(1, 1 + len(earlier))),
        *(source.name for source in inputs),
    ]
    return Fitted(model, names, photos, cuts, last, inputs[0].image, seconds)


def _read_inputs(args: argparse.Namespace, seconds: Seconds) -> Iterator[_Input]:
    """Read the images and cut out their objects; a video gives several."""
    nothing = [None] * len(args.images)
    hints = map(_hints, args.images, args.box or nothing, args.point or nothing, args.object or nothing)
    options = hints, args.mask or nothing, _poses(args) or nothing, args.sides or nothing
    for path, hint, mask, posed, side in zip(args.images, *options, strict=True):
        if is_clip(path):
            with _timed(seconds, "clip"):
                cuts = run_with_fraction(cut_out_clip(path, args.frames or FRAMES), path.name)
            _say(path, cuts.note)
            yield from (_Input(*frame) for frame in cuts.frames)
        else:
            yield _Input(path, *_cut_out(path, hint, mask, seconds), posed, side)


def say_doubts(fitted: Fitted) -> None:
    """Print warnings about a result whose camera may be wrong or was not assessed."""
    last = fitted.last
    if last.confidence is not None and last.confidence < DOUBTFUL:
        if len(fitted.photos) > 1:
            say(f"the cameras are doubtful (confidence {last.confidence:.2f}): look at renders from these sides")
        elif last.runner_up:
            camera = _camera_to_dict(last.runner_up.cameras[0])
            direction = f"azimuth {camera['azimuth']:.0f}, elevation {camera['elevation']:.0f}"
            doubt = f"the camera is doubtful (confidence {last.confidence:.2f})"
            say(f"{doubt}: it may be {direction}, or no object of this category")
    for number in last.left_out:
        say(f"{fitted.names[number]}: this looks like another object, so it is left out")


def fitted_scene(args: argparse.Namespace, last: FitStep) -> Scene:
    """Return the fitted scene of the first photo, without photo detail if so chosen."""
    instance = last.instance.with_detail(None) if args.no_photo_detail else last.instance
    return Scene(instance, last.cameras[0])


def to_dict(args: argparse.Namespace, fitted: Fitted) -> dict[str, object]:
    """Return a fit's JSON, with the seconds since the command began and those of its stages."""
    seconds = {"seconds": round(time.perf_counter() - args.began, 3), "seconds_by_part": fitted.seconds}
    return _step_to_dict(fitted.last) | seconds


def _split_sides(args: argparse.Namespace) -> None:
    """Split names such as ``back:chair.jpg`` into sides and paths, unless files have them; open folders."""
    pairs = [_side_and_path(photo) for path in args.images for photo in photos_at(path)]
    args.sides, args.images = (list(values) for values in zip(*pairs, strict=True))


def photos_at(path: Path) -> list[Path]:
    """Return the images of a folder, by name, which show one object; of a file, itself."""
    if not path.is_dir():
        return [path]
    if images := image_files(path):
        return images
    raise ValueError(f"{path}: no images in this folder")


def _side_and_path(path: Path) -> tuple[Side | None, Path]:
    side, separator, rest = str(path).partition(":")
    if separator and side in SIDES and not path.exists():
        return side, Path(rest)
    return None, path


def check_counts(args: argparse.Namespace) -> None:
    """Raise ``ValueError`` for options that contradict each other or the number of images."""
    count = len(args.images)
    plurals = {"pose": "poses", "box": "boxes", "point": "points", "mask": "masks", "object": "object numbers"}
    for name, plural in plurals.items():
        values = getattr(args, name)
        if values and len(values) != count and not (name == "pose" and _is_transforms(values)):
            raise ValueError(f"{count} images need as many {plural}, got {len(values)}")
        if values and (several := next((path for path in args.images if is_clip(path) or path.is_dir()), None)):
            raise ValueError(f"{several}: --{name} is of photos, not of a video or a folder")
    if args.estimate_focal and args.pose:
        raise ValueError("--estimate-focal searches the focal length of unknown cameras, but --pose gives them")


def _check_files(args: argparse.Namespace) -> None:
    """Raise ``ValueError`` for files that cannot be written, and options of ``--each`` without it."""
    if len(args.images) > MOST_PHOTOS:
        raise ValueError(f"one object has at most {MOST_PHOTOS} images: add --each for an object each")
    if args.cluster:
        raise ValueError("--cluster fits many photos, one object each: add --each")
    if args.resume and args.explain:
        raise ValueError("--explain describes a search, which --resume leaves out")
    if args.out and args.out.suffix.lower() != ".json":
        raise ValueError(f"{args.out.name}: a fitted scene must end in .json")
    _check_apart(args)
    if args.explain:
        if args.explain.exists() and not args.explain.is_dir():
            raise ValueError(f"cannot write {args.explain}: it is not a folder")
        args.explain.mkdir(parents=True, exist_ok=True)
    for path in filter(None, (args.out, args.log, args.explain and args.explain / "index.html")):
        require_writable(path)


def _check_apart(args: argparse.Namespace) -> None:
    """Raise ``ValueError`` if a file to write is also another one of the command, which would be lost."""
    taken = {path.resolve(): path for path in (*args.images, *(args.mask or ()), *(args.pose or ()))}
    for path in filter(None, (args.out, args.log)):
        if path.resolve() in taken:
            raise ValueError(f"cannot write {path}: this command needs it for something else; choose another name")
        taken[path.resolve()] = path


def _compare_categories(args: argparse.Namespace, inputs: Sequence[_Input]) -> None:
    """Raise ``ValueError`` if an image shows another category than the first; with ``--model`` print a warning."""
    for source in inputs[1:]:
        difference = describe_difference(inputs[0].cut.categories, source.cut.categories)
        if difference and not args.model:
            advice = "Fit each object by itself, or choose one model with --model"
            raise ValueError(f"{source.name}: {difference}. {advice}")
        _say(source.name, difference)


def _further_objects(cut: CutOut, hints: Hints | None) -> str:
    """Return a note about other objects nearly as prominent as the one cut out; "" for none."""
    if hints or cut.confidence == 1 or len(cut.detections) < 2:
        return ""
    first, second = cut.detections[:2]
    near = second.prominence > _AS_PROMINENT * first.prominence
    return f"{len(cut.detections)} objects are found: --object 2 fits the next one" if near else ""


@contextmanager
def _timed(seconds: Seconds, stage: str) -> Iterator[None]:
    """Add the duration of the ``with`` block to the seconds of a stage."""
    began = time.perf_counter()
    yield
    seconds[stage] = round(seconds.get(stage, 0.0) + time.perf_counter() - began, 3)


def _cut_out(path: Path, hints: Hints | None, mask: Path | None, seconds: Seconds) -> tuple[Image.Image, CutOut]:
    """Read an image and cut out its object."""
    try:
        with naming(path):
            with _timed(seconds, "decode"):
                image = read_rgba(path)
                if mask:
                    opacity = read_mask(mask, path, image.size)
                    image.putalpha(opacity)
                    _say(path, opacity.info[NOTE])
            with _timed(seconds, "cut_out"):
                cut = cut_out(image, hints)
        _say(path, cut.note)
        if not mask and cut.confidence < DOUBTFUL_MASK:
            doubt = f"the cut-out is doubtful ({cut.confidence:.2f}, by {cut.found_by})"
            _say(path, f"{doubt}: --point, --box or --mask helps")
        if not mask:
            _say(path, _further_objects(cut, hints))
        return image, cut
    except NoBackgroundError as error:
        raise ValueError(f"{error}; give a box with --box X0,Y0,X1,Y1") from None


def _say(path: Path | str, text: str) -> None:
    """Print a line about an image to stderr, unless it is empty."""
    if text:
        say(f"{path}: {text}")


def _poses(args: argparse.Namespace) -> list[PosedImage]:
    """Return the images' known cameras; none without ``--pose``."""
    files = args.pose * len(args.images) if _is_transforms(args.pose) else args.pose
    return list(map(find_pose, files, args.images, repeat(args.pose_axes), repeat(args.pose_scale)))


def _is_transforms(poses: Sequence[Path]) -> bool:
    """True for one file with the cameras of several images."""
    return len(poses) == 1 and poses[0].suffix.lower() == ".json"


def _photo(source: _Input, model: Model, scale: float) -> Photo:
    with naming(source.name):
        photo = prepare_photo(source.cut, model, source.posed)
        if source.posed and source.posed.focal and photo.camera:  # SRN's poses are in a model's units
            require_scale([photo.mask.numpy()], [photo.camera], scale)
        return replace(photo, side=source.side)


def _search(model: Model, job: FitJob, log: Path | None) -> FitStep:
    """Run a fit under a progress bar and return its last step; write all steps to ``log`` if given."""
    bar = tqdm(unit="step", leave=False, disable=bars_disabled())
    with bar, io.TextIOWrapper(open_output(log), line_buffering=True) if log else nullcontext() as file:
        lines = file and LastingOutput(file, str(log))
        for step in fit_as_set(model, job):
            bar.total = step.steps
            bar.set_postfix_str(f"{step.psnr:.2f} dB")
            bar.update()
            if lines:
                lines.write(json.dumps(_step_to_dict(step) | {"origin": step.origin}) + "\n")
    return step


def _hints(
    image: Path, box: tuple[float, ...] | None, point: tuple[float, float] | None, number: int | None
) -> Hints | None:
    """Return hints from a box or a point, in px of the upright image, or an object's number.

    A box is clipped to the image.
    """
    if box is None and point is None:
        return Hints(object=number - 1) if number else None
    width, height = upright_size(image)
    try:
        if point is not None:
            return Hints(points=((point[0] / width, point[1] / height),))
        left, top, right, bottom = box or ()
        return Hints((max(0, left) / width, max(0, top) / height, min(1, right / width), min(1, bottom / height)))
    except ValueError as error:
        raise ValueError(f"{image}: {error} of {width}x{height} px") from None


def _step_to_dict(step: FitStep) -> dict[str, object]:
    leading = _camera_to_dict(step.cameras[0])
    focal = leading.pop("focal")  # comes further down in the JSON
    second = step.runner_up
    return {
        **leading,
        "psnr": round(step.psnr, 3),
        "seconds": round(step.seconds, 3),
        "steps": step.step,
        "loss": step.loss,
        "confidence": step.confidence and round(step.confidence, 3),
        "uncertainty_deg": step.uncertainty and round(step.uncertainty, 3),
        "focal": focal,
        "runner_up": second and {**_camera_to_dict(second.cameras[0]), "loss": second.loss},
        "photos": [
            None
            if number in step.left_out
            else {**_camera_to_dict(camera), "confidence": confidence and round(confidence, 3)}
            for number, (camera, confidence) in enumerate(zip(step.cameras, step.confidences, strict=True))
        ],
    }


def _camera_to_dict(camera: Camera) -> dict[str, float]:
    return {
        "azimuth": round(math.degrees(camera.azimuth), 4),
        "elevation": round(math.degrees(camera.elevation), 4),
        "distance": round(camera.distance, 5),
        "focal": round(camera.focal / camera.height, 4),  # image heights
    }
