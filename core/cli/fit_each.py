"""``fit --each``: many photos or folders of photos, one object each, in processes of one thread each.

The folder of results has a row of JSON for each photo (``rows.jsonl``), scenes, and a contact sheet. A row is appended
when its scene is written, so that a command that is started again fits only the rest.
"""

import argparse
import hashlib
import json
import math
import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky.process_executor import TerminatedWorkerError
from PIL import Image, ImageDraw
from tqdm import tqdm

from core.cli.fit import check_counts, fit_images, fitted_scene, photos_at, say_doubts, to_dict
from core.cli.output import collected_lines, say
from core.export.films import View
from core.export.framing import filling_frame
from core.geometry.pixels import to_bytes
from core.models.scene import Scene
from core.photos.clip import is_clip
from core.photos.decode import on_white
from core.rendering.images import render_image
from core.runtime.files import atomic_file, require_writable
from core.runtime.pipes import refuse_pipe
from core.runtime.threads import thread_count, use_threads

Row = dict[str, Any]

_PER_IMAGE = "images", "pose", "point", "mask", "box", "object"
_FOR_ALL = "model", "pose_axes", "pose_scale", "preset", "estimate_focal", "no_photo_detail", "seed"
_ROWS, _SHEET = "rows.jsonl", "contact-sheet.png"
_DIED = "its process died, probably for want of memory: fewer --threads help"
_SIDE, _CAPTION, _GAP = 200, 18, 12  # px of an image's side, of a caption's height, between strips of the contact sheet
_BESIDE = math.radians(60)  # azimuth from the photo's camera
_CAPTION_LETTERS = 96  # that fit under three images
_PARENT_POLL = 0.5  # seconds between a process's looks for the command that started it


def fit_each(args: argparse.Namespace) -> None:
    """Run ``fit --each``: fit the photos that have no result in the folder yet, then write the contact sheet."""
    _check(args)
    fits = {_key(single): single for single in _single_fits(args)}  # a photo that is named twice is fitted once
    photos = {str(single.source) for single in fits.values()}
    earlier = _read_rows(args.out)
    finished = {  # failed photos are tried again
        key: row
        for key, row in earlier.items()
        if ("error" not in row and (args.out / f"{key}.json").exists()) or row["photo"] not in photos
    }
    with atomic_file(args.out / _ROWS) as partial:
        partial.write_text("".join(json.dumps(row) + "\n" for row in finished.values()), encoding="utf-8")
    missing = {key: single for key, single in fits.items() if key not in finished}
    rows = finished | _fit_missing(args, missing, len(fits))
    failed = sum("error" in rows[key] for key in fits)
    sheet = args.out / _SHEET
    _write_contact_sheet(sheet, [(args.out / f"{key}.png", _caption(rows[key])) for key in fits])
    reasons = f", {failed} failed ({args.out / _ROWS} says why)" if failed else ""
    say(f"{len(fits) - failed} of {len(fits)} photos are fitted{reasons}: {sheet}")


def _check(args: argparse.Namespace) -> None:
    """Raise ``ValueError`` for options that contradict each other; create the folder."""
    check_counts(args)
    if not args.out:
        raise ValueError("--each needs a folder for its results: --out FOLDER")
    if args.log or args.explain or args.resume:
        raise ValueError("--log, --explain and --resume are of a single fit: leave them or --each out")
    if args.cluster and not find_spec("distributed"):
        raise ValueError("--cluster needs Dask: pip install 'codenerf-viewer[cluster]'")
    if args.out.exists() and not args.out.is_dir():
        raise ValueError(f"cannot write {args.out}: it is not a folder")
    args.out.mkdir(parents=True, exist_ok=True)
    for name in (_ROWS, _SHEET):
        require_writable(args.out / name)


def _single_fits(args: argparse.Namespace) -> Iterator[argparse.Namespace]:
    """Yield the options of each fit, with absolute paths, as a cluster's workers run in other folders.

    ``source`` is the photo, or the folder of photos of one object.
    """
    for number, source in enumerate(args.images):
        options = {}
        for name in _PER_IMAGE:
            values = getattr(args, name)
            if len(values) == len(args.images):  # a transforms.json is for all images
                values = [values[number]]
            options[name] = [value.absolute() if isinstance(value, Path) else value for value in values]
        options["source"] = source.absolute()
        options["images"] = photos_at(source.absolute())
        model = str(Path(args.model).absolute()) if args.model and Path(args.model).is_file() else args.model
        yield argparse.Namespace(**{**vars(args), **options, "model": model, "out": args.out.absolute()})


def _key(single: argparse.Namespace) -> str:
    """Return the name of a fit's files: the photo's, and a digest of all contents and options that decide the result.

    So a photo that moved is not fitted again, and one that changed, or is fitted with other options, is.
    """
    digest = hashlib.sha256(single.source.name.encode(errors="surrogateescape"))
    for name in (*_PER_IMAGE, *_FOR_ALL, *(("frames",) if is_clip(single.source) else ())):
        value = getattr(single, name)
        for item in value if isinstance(value, list) else [value]:
            is_file = isinstance(item, Path) or (name == "model" and item and Path(item).is_absolute())
            digest.update(b"|" + name.encode() + (_content(Path(item)) if is_file else repr(item).encode()))
    return f"{single.source.stem[:60]}-{digest.hexdigest()[:8]}"


def _content(path: Path) -> bytes:
    """Return a digest of a file's content; empty if it cannot be read, which its fit will report."""
    try:
        refuse_pipe(path)
        return hashlib.sha256(path.read_bytes()).digest()
    except (OSError, ValueError):
        return b""


def _read_rows(folder: Path) -> dict[str, Row]:
    """Return the rows of earlier runs by key, without a line that was not finished."""
    path = folder / _ROWS
    rows = dict[str, Row]()
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        try:
            row = json.loads(line)
            rows[row["key"]] = row
        except (ValueError, TypeError, KeyError):
            continue
    return rows


def _caption(row: Row) -> str:
    name = Path(row["photo"]).name
    if "error" in row:
        return f"{name}: {row['error']}"
    sure = "" if row["confidence"] is None else f", confidence {row['confidence']:.2f}"
    return f"{name}  {row['psnr']:.1f} dB{sure}"


def _fit_missing(args: argparse.Namespace, missing: Mapping[str, argparse.Namespace], total: int) -> dict[str, Row]:
    """Fit under a progress bar; append each row to the file as it comes, and return all."""
    rows = dict[str, Row]()
    bar = tqdm(total=total, initial=total - len(missing), unit="photo", smoothing=0, disable=None)
    with bar, (args.out / _ROWS).open("a", encoding="utf-8") as file, _workers(args) as run:
        for row in _surviving(run, missing):
            rows[row["key"]] = row
            file.write(json.dumps(row) + "\n")
            file.flush()
            bar.update()
    return rows


_Run = Callable[[Iterator[tuple[str, argparse.Namespace]]], Iterator[Row]]


def _surviving(run: _Run, missing: Mapping[str, argparse.Namespace]) -> Iterator[Row]:
    """Yield a row for each fit. If a process dies, the fits that were under way are repeated one by one at the end."""
    waiting = dict(missing)
    suspects = dict[str, argparse.Namespace]()

    def begun() -> Iterator[tuple[str, argparse.Namespace]]:
        while waiting:
            key = next(iter(waiting))
            suspects[key] = waiting.pop(key)
            yield key, suspects[key]

    while waiting:
        try:
            for row in run(begun()):
                del suspects[row["key"]]
                yield row
        except TerminatedWorkerError:
            continue
    for key, single in suspects.items():
        try:
            yield from run(iter([(key, single)]))
        except TerminatedWorkerError:
            yield _identity(key, single) | {"error": _DIED}


@contextmanager
def _workers(args: argparse.Namespace) -> Iterator[_Run]:
    """Yield a function that runs fits and yields rows in the order in which they are done.

    It uses processes of this machine, or the workers of a Dask cluster.
    """
    with ExitStack() as stack:
        if args.cluster:
            from distributed import Client  # an optional extra

            client = stack.enter_context(Client(args.cluster, set_as_default=False))
            stack.enter_context(parallel_config("dask", client=client))
        else:
            stack.enter_context(parallel_config("loky", n_jobs=thread_count(), inner_max_num_threads=1))
        parallel = Parallel(return_as="generator_unordered", pre_dispatch="n_jobs", batch_size=1)
        settings = {name: value for name, value in os.environ.items() if name.startswith("CODENERF_")}
        command = os.getpid()
        yield lambda fits: parallel(delayed(_row)(key, single, settings, command) for key, single in fits)


def _row(key: str, single: argparse.Namespace, settings: Mapping[str, str], command: int) -> Row:
    """Fit one photo and write its files; return its row, with a reason instead of a result if it failed.

    Args:
        settings: environment variables of the command.
        command: its process, with which a worker on the same machine ends.
    """
    os.environ.update(settings)
    use_threads(1)
    _end_with(command)
    single.began = time.perf_counter()
    row = _identity(key, single)
    with collected_lines() as notes:
        try:
            row |= _fit_one(key, single)
        except Exception as error:  # of any kind: the other photos go on
            row["error"] = " ".join(str(error).split()) or type(error).__name__
    return row | {"notes": notes}


def _fit_one(key: str, single: argparse.Namespace) -> Row:
    """Fit one photo, and write its scene and its strip of the contact sheet; return the result as a dictionary."""
    fitted = fit_images(single)
    say_doubts(fitted)
    scene = fitted_scene(single, fitted.last)
    with atomic_file(single.out / f"{key}.png") as partial:
        _photo_strip(fitted.image, scene).save(partial)
    scene.save(single.out / f"{key}.json")  # last: it marks the photo as done
    return {"category": fitted.model.category, **to_dict(single, fitted)}


def _identity(key: str, single: argparse.Namespace) -> Row:
    return {"photo": str(single.source), "key": key}


@cache
def _end_with(command: int) -> None:
    """End this process soon after the command that started it, however that ends."""

    def watch() -> None:
        while os.getppid() == command:
            time.sleep(_PARENT_POLL)
        os._exit(1)

    if os.getppid() == command:
        threading.Thread(target=watch, daemon=True).start()


# The contact sheet: each photo, its object from the photo's camera, and from beside it


def _photo_strip(image: Image.Image, scene: Scene) -> Image.Image:
    """Return a photo beside renders from its camera and from 60° beside, without photo detail."""
    photo = on_white(image)
    photo.thumbnail((_SIDE, _SIDE))
    strip = Image.new("RGB", (3 * _SIDE, _SIDE), "white")
    strip.paste(photo, ((_SIDE - photo.width) // 2, (_SIDE - photo.height) // 2))
    camera = scene.camera.resized(_SIDE, _SIDE)
    cameras = camera, replace(camera, azimuth=camera.azimuth + _BESIDE)
    views = filling_frame([View(scene.instance, camera) for camera in cameras])
    for number, view in enumerate(views, 1):
        strip.paste(Image.fromarray(to_bytes(render_image(*view).colour)), (number * _SIDE, 0))
    return strip


def _write_contact_sheet(path: Path, strips: Sequence[tuple[Path, str]]) -> None:
    """Write an image of strips (files) and their captions in columns; a missing strip leaves its place empty."""
    width = 3 * _SIDE + _GAP
    height = _SIDE + _CAPTION + _GAP
    columns = max(1, round(math.sqrt(len(strips) * height / width)))
    rows = math.ceil(len(strips) / columns)
    sheet = Image.new("RGB", (columns * width + _GAP, rows * height + _GAP), "white")
    pen = ImageDraw.Draw(sheet)
    for number, (strip, caption) in enumerate(strips):
        left = number % columns * width + _GAP
        top = number // columns * height + _GAP
        if strip.exists():
            with Image.open(strip) as image:
                sheet.paste(image, (left, top))
        pen.text((left, top + _SIDE + 2), caption[:_CAPTION_LETTERS], "black")
    with atomic_file(path) as partial:
        sheet.save(partial)
