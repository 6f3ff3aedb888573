"""``render``, ``turntable``, ``mesh`` and ``page``: an object as an image, a video, a mesh and a web page."""

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, pairwise
from pathlib import Path

from tqdm import tqdm

from core.cli.output import say
from core.cli.progress import run_with_progress
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
from core.models.scene import Scene, open_scene, save_image, scene_model
from core.runtime.files import require_writable
from core.streams import run_to_end


def render(chosen: argparse.Namespace) -> None:
    """Run ``render``: write one image."""
    instance, camera = _load_view(chosen)
    require_writable(chosen.out)
    camera = camera.resized(*chosen.size)
    if chosen.distance is None and not chosen.scene:
        (_, camera), *_ = filling_frame([View(instance, camera)])
    if chosen.dimensions:
        ((_, camera),) = with_room([View(instance, camera)])
    if chosen.exact:
        image = to_bytes(render_reference(instance, camera).colour)
    else:
        image = render_frame(instance, camera).image
    if chosen.dimensions:
        image = draw_dimensions(image, View(instance, camera), chosen.dimensions)
    save_image(image, chosen.out, Scene(instance, camera))


def turntable(chosen: argparse.Namespace) -> None:
    """Run ``turntable``: write a video of a turn, a swing, or a morph into another object and back."""
    instance, camera = _load_view(chosen, from_photo=True)
    camera = camera.resized(*chosen.size)
    background = None if chosen.transparent else WHITE
    settings = VideoSettings(chosen.fps, chosen.quality, background, chosen.exact, chosen.shadow, chosen.dimensions)
    if chosen.to is not None:
        shots = films.morph(instance, _partner(chosen.to, instance), camera, chosen.frames or films.TURN)
    elif chosen.swing:
        shots = films.swing(instance, camera, chosen.frames or films.SWING)
    else:
        shots = films.turntable(instance, camera, chosen.frames or films.TURN)
    if chosen.distance is None:
        shots = filling_frame(shots)
    if chosen.dimensions:
        shots = with_room(shots)
    written = write_video(shots, chosen.out, settings)
    counts = (count for before, count in pairwise(chain((0,), written)) if count > before)
    run_with_progress(counts, _shown_frames(shots, chosen), "frame")


def _partner(to: int | Path, instance: Instance) -> Instance:
    """Return the object that another one morphs into: a training object by its number, or that of a scene."""
    return instance.model[to] if isinstance(to, int) else open_scene(to, instance.model).instance


def _shown_frames(shots: Sequence[View], chosen: argparse.Namespace) -> int:
    """Return the number of frames of a video; print a warning if its format shows fewer than were asked for."""
    if chosen.out.suffix.lower() not in FORMATS:
        return len(shots)  # the writer refuses it
    count = len(shown_views(shots, chosen.out, chosen.fps))
    if count < len(shots):
        most = FORMATS[chosen.out.suffix.lower()].most_rate
        say(f"{chosen.out}: browsers show at most {most} frames a second of it, so {count} of {len(shots)} are kept")
    return count


def mesh(chosen: argparse.Namespace) -> None:
    """Run ``mesh``: write an object as a coloured mesh."""
    from core.export.mesh import MeshSettings, export_mesh  # imports scipy, which videos and images do not need
    from core.export.print_formats import LARGEST_PRINT, PRINTED

    instance, camera = _load_selection(chosen)
    metres = chosen.metres or (None if instance.is_sized else instance.model.metres)
    settings = MeshSettings(chosen.resolution, metres, chosen.texture or 0, chosen.triangles or 0)
    if chosen.out.suffix.lower() in PRINTED and (side := metres or max(size_of(instance)) / 100) > LARGEST_PRINT:
        say(f"{chosen.out}: {side:.1f} m long, larger than any printer builds; --metres makes it smaller")
    variants = _variants(chosen, instance)
    fractions = export_mesh(instance, chosen.out, settings, camera if chosen.scene else None, variants)
    with tqdm(total=1.0, bar_format="{percentage:3.0f} %|{bar}| {elapsed}", leave=False, disable=None) as bar:
        doubt = run_to_end(fractions, lambda fraction: bar.update(fraction - bar.n))
    if doubt:
        say(f"{chosen.out}: {doubt}")


def page(chosen: argparse.Namespace) -> None:
    """Run ``page``: write an object as a web page in one file."""
    from core.export.page import PageExtras, first_camera, write_page

    instance, camera = _load_view(chosen, from_photo=True)
    if chosen.distance is None:
        camera = first_camera(instance, camera)
    if chosen.dimensions:
        ((_, camera),) = with_room([View(instance, camera)])
    name = chosen.name or (chosen.scene.stem if chosen.scene else instance.model.noun.capitalize())
    extras = PageExtras(_variants(chosen, instance), chosen.dimensions or "", chosen.ar)
    for _ in write_page(instance, camera, chosen.out, name, extras):
        pass


def _variants(chosen: argparse.Namespace, instance: Instance) -> dict[str, Instance]:
    """Return the object and its ``--variants`` by name; none without them. Raises ``ValueError`` for equal names."""
    if not chosen.variants:
        return {}
    variants = {chosen.scene.stem if chosen.scene else instance.model.noun: instance}
    for path in chosen.variants:
        if path.stem in variants:
            raise ValueError(f"two variants are named {path.stem}: rename one of the files")
        variants[path.stem] = _opened(chosen, path, instance.model).instance
    return variants


def _load_view(chosen: argparse.Namespace, from_photo: bool = False) -> View:
    """Return the chosen object and camera, with the camera's options applied.

    Args:
        from_photo: use the camera of the object's photo, if it has one, in place of the scene's.
    """
    instance, camera = _load_selection(chosen)
    if from_photo:
        camera = Scene(instance, camera).photo_camera
    options = {name: getattr(chosen, name) for name in ("azimuth", "elevation", "distance")}
    return View(instance, replace(camera, **{name: value for name, value in options.items() if value is not None}))


def _load_selection(chosen: argparse.Namespace) -> View:
    """Return the chosen object, and the scene's camera or the default one."""
    model = load_model(model_with(chosen.scene and scene_model(chosen.scene), chosen.model), chosen.device)
    if chosen.scene:
        return _opened(chosen, chosen.scene, model)
    instance = model.mean if chosen.object is None else model[chosen.object]
    return View(_edited(chosen, instance), model.camera(math.radians(60), math.radians(20)))


def _opened(chosen: argparse.Namespace, path: Path, model: Model) -> View:
    """Return the object and the camera of a scene, with the edits of the options."""
    scene = open_scene(path, model)
    instance = scene.instance.with_detail(None) if chosen.no_photo_detail else scene.instance
    return View(_edited(chosen, instance), scene.camera)


def _edited(chosen: argparse.Namespace, instance: Instance) -> Instance:
    """Apply ``--edit``, ``--paint``, ``--size-cm``, ``--legs-cm`` and ``--roof-cm`` to an object."""
    if chosen.edit:
        *_, words = direction_words(instance.model)
        assert words is not None
        for name, amount in chosen.edit:
            limit = most(instance, words, name)
            if amount > limit:
                say(f"{name}={amount:g}: ends at {limit:.2g}")
            instance = moved(instance, words, name, amount)
    for part, colour in chosen.paint:
        instance = run_to_end(paint(instance, Paint(colour, part)))
    lengths = dict(zip(SIDES, chosen.size_cm or (), strict=False)) | dict(filter(None, [chosen.portion_cm]))
    return sized(instance, **lengths) if lengths else instance
