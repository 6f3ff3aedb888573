"""A contact sheet of fitted photos: each photo, its object from the photo's camera, and from beside it."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from PIL import Image, ImageDraw

from core.export.films import View
from core.export.framing import filling_frame
from core.geometry.pixels import to_bytes
from core.models.scene import Scene
from core.photos.decode import on_white
from core.rendering.images import render_image
from core.runtime.files import atomic_file

_SIDE, _CAPTION, _GAP = 200, 18, 12  # px of an image's side, of a caption's height, between strips
_BESIDE = math.radians(60)  # azimuth from the photo's camera
_CAPTION_LETTERS = 96  # that fit under three images


def photo_strip(image: Image.Image, scene: Scene) -> Image.Image:
    """Return a photo beside renders from its camera and from 60° beside, without photo detail."""
    photo = on_white(image)
    photo.thumbnail((_SIDE, _SIDE))
    strip = Image.new("RGB", (3 * _SIDE, _SIDE), "white")
    strip.paste(photo, ((_SIDE - photo.width) // 2, (_SIDE - photo.height) // 2))
    camera = scene.camera.resized(_SIDE, _SIDE)
    cameras = camera, replace(camera, azimuth=camera.azimuth + _BESIDE)
    views = filling_frame([View(scene.instance, camera) for camera in cameras])
    for number, view in enumerate(views, 1):
        colour = render_image(*view).colour
        strip.paste(Image.fromarray(to_bytes(colour.cpu().clamp(0, 1).numpy())), (number * _SIDE, 0))
    return strip


def write_contact_sheet(path: Path, strips: Sequence[tuple[Path, str]]) -> None:
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
