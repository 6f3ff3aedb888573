"""Stand-ins for the streams that take seconds: renders, photos and fits that are made at once."""

import math
import shutil
import threading
import time
from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from core.detail.progressive import Frame, RenderJob, RenderSettings
from core.editing.paint import Paint
from core.editing.parts import Box, Handle, PartMap
from core.edits.paint import PartPaint, Rgb
from core.export.films import View
from core.export.video_frames import over
from core.fitting.fit import FitJob, FitStep, Hypothesis, RunnerUp
from core.fitting.photo_views import with_photo_detail
from core.geometry.camera import Camera
from core.gl.background import Background
from core.gl.baked_field import BakedField
from core.models.field_config import FieldConfig
from core.models.model import Instance, Model
from core.models.photo_detail import PhotoDetail, PhotoView
from core.models.scene import Scene
from core.photos.detector import Detection
from core.photos.photo import Photo, read_cut_out
from core.photos.segmentation import CutOut, Hints
from tests.conftest import random_model
from tests.core.tiny import tiny_bank
from viewer.services.backend import frame_photo
from viewer.values.fit_history import PhotoSource


class Clock:
    """Stands until it is moved."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def two_models() -> dict[str, Model]:
    """By name: chairs, and cars, which are called ``car 0`` and so on."""
    chairs, cars = map(with_quick_bank, (random_model(), random_model(5)))
    named = tuple(entry._replace(name=entry.name.replace("object", "car")) for entry in cars.codes.objects)
    return {"chairs": chairs, "cars": replace(cars, category="cars", codes=replace(cars.codes, objects=named))}


def block(photo: Path, name: str) -> Path:
    """Return a copy of a photo, called *block* and a name."""
    return Path(shutil.copy(photo, photo.with_name(f"block {name}.png")))


def blue_block(photo: Path) -> Path:
    """Return a copy of a photo with red and blue exchanged: a car, as the guess of the fixture ``both`` has it."""
    path = photo.with_name("block blue.png")
    with Image.open(photo) as image:
        red, green, blue = image.split()
        Image.merge("RGB", (blue, green, red)).save(path)
    return path


def shifted(instance: Instance, by: float) -> Instance:
    """Return an object with a number added to its texture code."""
    return instance.changed(texture=instance.codes.texture + by)


def photographed(scene: Scene) -> Scene:
    """Return a scene whose object has a photo, white, from azimuth 1 rad and elevation 0.4 rad."""
    instance = scene.instance
    view = PhotoView.of(np.full((30, 40, 4), 255, np.uint8), instance.model.camera(1.0, 0.4).resized(40, 30))
    return replace(scene, instance=instance.changed(detail=PhotoDetail.of((view,), instance.codes)))


def codes_key(instance: Instance) -> tuple[str, bytes, bytes]:
    """Return an object's model, shape and texture, to compare and to send to another process."""
    return instance.fingerprint, instance.codes.shape.numpy().tobytes(), instance.codes.texture.numpy().tobytes()


def quick_frames(job: RenderJob) -> Iterator[Frame | None]:
    """A disc whose colour follows the texture, its size the shape and the distance, its place the camera's angles."""
    instance = job.instance
    camera = job.camera
    stages = job.settings.divisors
    for stage, divisor in enumerate(stages):
        width = max(1, camera.width // divisor)
        height = max(1, camera.height // divisor)
        y, x = np.mgrid[0:height, 0:width] / min(width, height)
        middle_x = width / height / 2 + 0.2 * math.sin(camera.azimuth)
        middle_y = 0.5 + 0.2 * math.sin(camera.elevation)
        radius = (0.3 + 0.05 * math.tanh(float(instance.codes.shape.sum()))) / camera.distance
        opacity = (np.hypot(x - middle_x, y - middle_y) < radius).astype(np.float32)
        colour = np.array([0.5 + 0.5 * math.tanh(value) for value in (instance.codes.texture.tolist() * 3)[:3]])
        colour = np.array([paint.colour for paint in instance.codes.of_kind(PartPaint)] or [colour])[-1]
        image = (255 * (1 - opacity[..., None] * (1 - colour))).astype(np.uint8)
        yield None
        yield Frame(image, opacity, opacity, stage, len(stages), job.settings.samples, 0.01 * (stage + 1))


def quick_pictures(
    views: Sequence[View], background: Background | None, exact: bool = False, shadow: bool = False
) -> Iterator[np.ndarray | None]:
    """Frames of :func:`quick_frames`, one for each view."""
    for instance, camera in views:
        for frame in quick_frames(RenderJob(instance, camera, RenderSettings(divisors=(1,)))):
            yield over(frame, background) if frame else None


def quick_photo(cut: CutOut, model: Model, source: PhotoSource) -> Photo:
    """The real thing cannot frame a block for a model of mists."""
    if not source.path.stem.startswith("block"):
        return frame_photo(cut, model, source)
    pixels = torch.from_numpy(cut.pixels)[::3, ::3].contiguous()
    return Photo(pixels, pixels.mean(-1) < 0.9)


def doubted(path: Path, hints: Hints | None) -> CutOut:
    """Cut out, but never surely, of a photo of two objects."""
    car = Detection((0.3, 0.2, 0.7, 0.8), {"chairs": 0.1, "cars": 0.9})
    return replace(read_cut_out(path, hints), confidence=0.2, detections=(car,), white=False)


def crowded(path: Path, hints: Hints | None) -> CutOut:
    """Surely cut out, but two objects are nearly as prominent."""
    chair = Detection((0.0, 0.2, 0.5, 0.8), {"chairs": 0.9, "cars": 0.1})
    neighbour = chair._replace(box=(0.5, 0.2, 1.0, 0.8))
    return replace(read_cut_out(path, None), detections=(chair, neighbour), white=False)


def quick_paint(instance: Instance, paint: Paint) -> Generator[None, None, Instance]:
    """The object's only paint has the colour."""
    yield None
    return instance.with_edits(PartPaint, PartPaint(paint.part, paint.colour, (0.5, 0.5, 0.5)))


def quick_colour(instance: Instance, part_name: str) -> Generator[None, None, Rgb]:
    """The colour that :func:`quick_paint` gives."""
    yield None
    if instance.codes.of_kind(PartPaint):
        return instance.codes.of_kind(PartPaint)[-1].colour
    red, green, blue = instance.codes.texture[:3].clamp(0, 1).tolist()
    return red, green, blue


def with_quick_bank(model: Model) -> Model:
    """The model with the view bank of another one."""
    return replace(model, view_bank=tiny_bank())


def no_guess(cut: CutOut) -> dict[str, float]:
    """Nothing is said about the category."""
    return {}


def quick_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
    """Ten steps towards object 3, seen from azimuth 1 rad, or else from behind; four are active, then two.

    Where it resumes, the camera is the given one.
    """
    known_cameras = [photo.camera for photo in job.photos]
    for step in range(10):
        instance = model.mean.mixed(model[3], step / 9, step / 9)
        loss = math.exp(-step)
        hypotheses = list[Hypothesis]()
        for start in range(4 if step < 5 else 2):
            height, width = job.photos[0].mask.shape
            camera = model.camera(1.0 + start * math.pi / 2, 0.3 + 0.01 * step).resized(width, height)
            begin = job.resume_from if not start else None
            first = (*(begin.cameras if begin else ()), *(camera for _ in job.photos))[: len(job.photos)]
            cameras = tuple(camera or start_camera for camera, start_camera in zip(known_cameras, first, strict=True))
            origin = begin.origin if begin else start
            crops = torch.zeros(len(known_cameras), 4)
            hypotheses.append(Hypothesis(origin, (1 + 0.1 * start) * loss, cameras, instance, crops))
        behind = tuple(replace(camera, azimuth=camera.azimuth + math.pi) for camera in hypotheses[0].cameras)
        yield FitStep(
            *(step + 1, 10, 0, loss, 10.0 + step, 0.1 * step, hypotheses[0].cameras, instance, len(hypotheses)),
            runner_up=RunnerUp(behind, 1.1 * loss),
            margin=math.log(1.1),
            uncertainty=1.0,
            hypotheses=tuple(hypotheses),
        )


def detailed_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
    """The same; the last step has offsets of the biases and the detail of the photos, as that of a real fit."""
    *steps, last = quick_fit(model, job)
    yield from steps
    generator = torch.Generator().manual_seed(0)
    shape, texture = ((0.3 * torch.randn(std.shape, generator=generator)).half() for std in model.bias_std)
    instance = last.instance.changed(shape_offsets=shape, texture_offsets=texture)
    yield with_photo_detail(job.photos, replace(last, instance=instance, search_psnr=last.psnr))


class CheckedFit:
    """Ten steps towards object 3, then a second search until it is told to end, whose result is object 4."""

    def __init__(self) -> None:
        self.may_end = threading.Event()

    def __call__(self, model: Model, job: FitJob) -> Iterator[FitStep]:
        first = list(quick_fit(model, job))
        yield from first
        step = replace(first[-1], step=11, steps=20, seconds=1.5, restart=True)
        while not self.may_end.is_set():
            time.sleep(0.01)
            yield step
        yield replace(step, step=20, cameras=first[-1].runner_up.cameras, instance=model[4])


def endless_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
    """Never ends by itself."""
    while True:
        for step in quick_fit(model, job):
            time.sleep(0.01)
            yield step


class HeldFit:
    """Goes on without an end until it is told to; later fits take ten steps."""

    def __init__(self) -> None:
        self.may_end = threading.Event()

    def __call__(self, model: Model, job: FitJob) -> Iterator[FitStep]:
        while not self.may_end.is_set():
            time.sleep(0.01)
            yield next(quick_fit(model, job))
        yield from quick_fit(model, job)


def broken_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
    """Fails after three steps."""
    for step in quick_fit(model, job):
        if step.step == 4:
            raise ValueError("the loss is not finite")
        yield step


class Bakery:
    """Bakes nothing that is seen; counts its streams."""

    def __init__(self) -> None:
        self.baked: list[Instance] = []

    def __call__(self, instance: Instance) -> Iterator[BakedField | None]:
        self.baked.append(instance)
        for cells in (64, 128):
            yield None
            texels = np.zeros((cells + 1,) * 3 + (4,), np.uint8)
            occupied = np.ones((64,) * 3, np.uint8)
            yield BakedField(texels, occupied, instance.model.extent, FieldConfig(), 0.0, cells)


def two_parts(instance: Instance, camera: Camera, frame: Frame, box: Box, is_outer: bool = True) -> PartMap:
    """The left half of the object is its seat, the right one its back; their handles are in the middle of each."""
    rows, columns = (frame.opacity > 0.5).nonzero()
    regions = np.full(frame.opacity.shape, -1)
    regions[rows, columns] = columns > columns.mean()
    handles = []
    for index, part_name in enumerate(("seat", "back")):
        rows, columns = (regions == index).nonzero()
        middle = (columns.mean() + 0.5) / regions.shape[1], (rows.mean() + 0.5) / regions.shape[0]
        handles.append(Handle(part_name, middle, (0.0, 0.0, 0.3), is_outer))
    return PartMap(tuple(handles), regions)
