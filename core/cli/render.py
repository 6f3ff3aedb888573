"""``render``, ``turntable``, ``mesh`` and ``page``: an object as an image, a video, a mesh and a web page."""

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, pairwise
from pathlib import Path

from core.cli.output import say
from core.cli.progress import run_with_fraction, run_with_progress
from core.detail.progressive import render_frame, render_reference
from core.editing.paint import Paint, paint
from core.editing.size import SIDES, size_of, sized
from core.editing.words import direction_words, most, moved
from core.export import films
from core.export.dimensions import draw_dimensions, with_room
from core.export.films import View
from core.export.framing import filling_frame
from core.export.video import FORMATS, WHITE, VideoSettings, shown_views, write_video
from core.geometry.pixels import to_bytes
from core.models.library import load_model, model_with
from core.models.model import Instance, Model
from core.models.scene import Scene, save_image, scene_model
from core.runtime.files import require_writable
from core.streams import run_to_end


def render(args: argparse.Namespace) -> None:
    """Run ``render``: write one image."""
    instance, camera = _load_view(args)
    require_writable(args.out)
    camera = camera.resized(*args.size)
    if args.distance is None and not args.scene:
        (_, camera), *_ = filling_frame([View(instance, camera)])
    if args.dimensions:
        ((_, camera),) = with_room([View(instance, camera)])
    image = to_bytes(render_reference(instance, camera).colour) if args.exact else render_frame(instance, camera).image
    if args.dimensions:
        image = draw_dimensions(image, View(instance, camera), args.dimensions)
    save_image(image, args.out, Scene(instance, camera))


def turntable(args: argparse.Namespace) -> None:
    """Run ``turntable``: write a video of a turn, a swing, or a morph into another object and back."""
    instance, camera = _load_view(args, from_photo=True)
    camera = camera.resized(*args.size)
    background = None if args.transparent else WHITE
    settings = VideoSettings(args.fps, args.quality, background, args.exact, args.shadow, args.dimensions)
    if args.to is not None:
        model = instance.model
        partner = model[args.to] if isinstance(args.to, int) else Scene.load(args.to, model).instance
        shots = films.morph(instance, partner, camera, args.frames or films.TURN)
    elif args.swing:
        shots = films.swing(instance, camera, args.frames or films.SWING)
    else:
        shots = films.turntable(instance, camera, args.frames or films.TURN)
    if args.distance is None:
        shots = filling_frame(shots)
    if args.dimensions:
        shots = with_room(shots)
    written = write_video(shots, args.out, settings)
    counts = (count for previous, count in pairwise(chain((0,), written)) if count > previous)
    run_with_progress(counts, _shown_frames(shots, args), "frame")


def _shown_frames(shots: Sequence[View], args: argparse.Namespace) -> int:
    """Return the number of frames of a video; print a warning if its format shows fewer than were asked for."""
    if args.out.suffix.lower() not in FORMATS:
        return len(shots)  # the writer refuses it
    count = len(shown_views(shots, args.out, args.fps))
    if count < len(shots):
        limit = FORMATS[args.out.suffix.lower()].most_rate
        say(f"{args.out}: browsers show at most {limit} frames a second of it, so {count} of {len(shots)} are kept")
    return count


def mesh(args: argparse.Namespace) -> None:
    """Run ``mesh``: write an object as a coloured mesh."""
    from core.export.mesh import MeshSettings, export_mesh  # imports scipy, which videos and images do not need
    from core.export.print_formats import LARGEST_PRINT, PRINTED

    instance, camera = _load_view(args)
    metres = args.metres or (None if instance.is_sized else instance.model.metres)
    settings = MeshSettings(args.resolution, metres, args.texture or 0, args.triangles or 0)
    if args.out.suffix.lower() in PRINTED and (side := metres or max(size_of(instance)) / 100) > LARGEST_PRINT:
        say(f"{args.out}: {side:.1f} m long, larger than any printer builds; --metres makes it smaller")
    variants = _variants(args, instance)
    written = export_mesh(instance, args.out, settings, camera if args.scene else None, variants)
    doubt = run_with_fraction(written, args.out.name)
    if doubt:
        say(f"{args.out}: {doubt}")


def page(args: argparse.Namespace) -> None:
    """Run ``page``: write an object as a web page in one file."""
    from core.export.page import PageExtras, first_camera, write_page

    instance, camera = _load_view(args, from_photo=True)
    if args.distance is None:
        camera = first_camera(instance, camera)
    if args.dimensions:
        ((_, camera),) = with_room([View(instance, camera)])
    name = args.name or (args.scene.stem if args.scene else instance.model.noun.capitalize())
    extras = PageExtras(_variants(args, instance), args.dimensions or "", args.ar)
    for _ in write_page(instance, camera, args.out, name, extras):
        pass


def _variants(args: argparse.Namespace, instance: Instance) -> dict[str, Instance]:
    """Return the object and its ``--variants`` by name; none without them. Raises ``ValueError`` for equal names."""
    if not args.variants:
        return {}
    variants = {args.scene.stem if args.scene else instance.model.noun: instance}
    for path in args.variants:
        if path.stem in variants:
            raise ValueError(f"two variants are named {path.stem}: rename one of the files")
        variants[path.stem] = _opened(args, path, instance.model).instance
    return variants


def _load_view(args: argparse.Namespace, from_photo: bool = False) -> View:
    """Return the chosen object and camera, with the camera's options applied to the scene's, or the photo's if any."""
    model = load_model(model_with(args.scene and scene_model(args.scene), args.model), args.device)
    if args.scene:
        instance, camera = _opened(args, args.scene, model)
    else:
        instance = _edited(args, model.mean if args.object is None else model[args.object])
        camera = model.camera(math.radians(60), math.radians(20))
    if from_photo:
        camera = Scene(instance, camera).photo_camera
    options = {name: getattr(args, name, None) for name in ("azimuth", "elevation", "distance")}  # none of a mesh
    return View(instance, replace(camera, **{name: value for name, value in options.items() if value is not None}))


def _opened(args: argparse.Namespace, path: Path, model: Model) -> View:
    """Return the object and the camera of a scene, with the edits of the options."""
    scene = Scene.load(path, model)
    instance = scene.instance.with_detail(None) if args.no_photo_detail else scene.instance
    return View(_edited(args, instance), scene.camera)


def _edited(args: argparse.Namespace, instance: Instance) -> Instance:
    """Apply ``--edit``, ``--paint``, ``--size-cm``, ``--legs-cm`` and ``--roof-cm`` to an object."""
    if args.edit:
        *_, words = direction_words(instance.model)
        assert words is not None
        for name, amount in args.edit:
            limit = most(instance, words, name)
            if amount > limit:
                say(f"{name}={amount:g}: ends at {limit:.2g}")
            instance = moved(instance, words, name, amount)
    for part, colour in args.paint:
        instance = run_to_end(paint(instance, Paint(colour, part)))
    lengths = dict(zip(SIDES, args.size_cm or (), strict=False)) | dict(filter(None, [args.portion_cm]))
    return sized(instance, **lengths) if lengths else instance
