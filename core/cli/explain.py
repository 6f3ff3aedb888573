"""``fit --explain``: a web page of the networks' findings about a photo, and the two best results of its fit."""

import html
import math
from collections.abc import Iterator
from pathlib import Path

from jaxtyping import Float
from PIL import Image, ImageDraw
from torch import Tensor

from core.classifiers.viewpoint import directions, predict_viewpoint
from core.fitting.steps import FitStep
from core.geometry.pixels import to_bytes
from core.models.model import Model
from core.photos.chair_box import EDGES
from core.photos.decode import on_white
from core.photos.photo import Photo
from core.photos.segmentation import CutOut
from core.rendering.images import render_image

_SIDE, _DETECTIONS = 240, 480  # px of an image's side
_MARGIN = 0.2  # fraction of a side that is cropped on each side
_RESULTS = "result", "runner-up"
_STYLE = (
    "body{font:14px sans-serif;margin:2em}figure{display:inline-block;margin:4px;vertical-align:top}"
    "figcaption{text-align:center}td{padding:2px 10px}"
)


def write_page(model: Model, photo: Photo, last: FitStep, detections: Image.Image, folder: Path) -> Path:
    """Write ``index.html`` and its images into an existing folder, of a fit's first photo; return the page's path."""
    opacity = photo.mask.float() if photo.opacity is None else photo.opacity
    images = [("Detections", detections), ("Photo as fitted", _middle(photo.pixels))]
    images.append(("Mask", _middle(opacity[..., None].expand(-1, -1, 3))))
    for name, hypothesis in zip(_RESULTS, last.hypotheses, strict=False):
        camera = hypothesis.cameras[0].resized(2 * _SIDE, 2 * _SIDE)
        images.append((name.capitalize(), _middle(render_image(hypothesis.instance, camera).colour)))
    figures = list[str]()
    for number, (caption, image) in enumerate(images):
        image.save(folder / f"{number}.png")
        figures.append(f"<figure><img src={number}.png><figcaption>{caption}</figcaption></figure>")
    cells = ("".join(f"<td>{html.escape(cell)}</td>" for cell in row) for row in _witnesses(model, photo, last))
    rows = "\n".join(f"<tr>{row}</tr>" for row in cells)
    page = folder / "index.html"
    head = f"<!doctype html><meta charset=utf-8><title>A fit explained</title><style>{_STYLE}</style>"
    page.write_text(f"{head}\n{''.join(figures)}\n<table>{rows}</table>\n", encoding="utf-8")
    return page


def draw_detections(image: Image.Image, cut: CutOut) -> Image.Image:
    """Draw the numbered boxes of chairs and cars, and a chair's 3D box with an orange front, over a photo."""
    drawing = on_white(image)
    drawing.thumbnail((_DETECTIONS, _DETECTIONS))
    pen = ImageDraw.Draw(drawing)
    for number, detection in enumerate(cut.detections, 1):
        left, top, right, bottom = (side * size for side, size in zip(detection.box, drawing.size * 2, strict=True))
        pen.rectangle((left, top, right, bottom), outline="lime")
        label = f"{number}: {detection.category} {detection.score:.2f}"
        pen.text((left + 3, top + 2), label, "lime", stroke_width=2, stroke_fill="black")
    if cut.corners is not None:
        corners = [tuple(corner) for corner in (cut.corners * drawing.size).tolist()]
        for edge in EDGES:
            front = all((corner - 1) % 2 for corner in edge)
            pen.line([corners[corner] for corner in edge], "orange" if front else "cyan", 2)
    return drawing


def _middle(pixels: Float[Tensor, "height width 3"]) -> Image.Image:
    """Return the middle of an image of the object, without the wide margins of a model's images."""
    image = Image.fromarray(to_bytes(pixels))
    margin_x, margin_y = (_MARGIN * side for side in image.size)
    return image.resize((_SIDE, _SIDE), box=(margin_x, margin_y, image.width - margin_x, image.height - margin_y))


def _witnesses(model: Model, photo: Photo, last: FitStep) -> Iterator[tuple[str, ...]]:
    """Yield rows of witness, direction or category, and remark."""
    for category, probability in photo.categories.items():
        yield "detector", category, f"probability {probability:.2f}"
    yield "cut-out", f"edges within {photo.edge_error:.1f} px", f"confidence {photo.mask_confidence:.2f}"
    if model.viewpoint_classifier is not None:
        probabilities = predict_viewpoint(model.viewpoint_classifier, photo.pixels, photo.mask)
        azimuth, elevation = (float(angles[probabilities.argmax()]) for angles in directions())
        yield "viewpoint classifier", _degrees(azimuth, elevation), f"probability {probabilities.max():.2f}"
    if photo.direction is not None:
        yield "3D box", _degrees(*photo.direction), "front and back may be confused"
    for name, hypothesis in zip(_RESULTS, last.hypotheses, strict=False):
        camera = hypothesis.cameras[0]
        yield name, _degrees(camera.azimuth, camera.elevation), f"loss {hypothesis.loss:.4f}"
    if last.confidence is not None:
        yield "confidence", f"{last.confidence:.2f}", f"uncertainty {last.uncertainty:.1f}°, {last.psnr:.1f} dB"


def _degrees(azimuth: float, elevation: float) -> str:
    return (
        f"azimuth {math.degrees(math.remainder(azimuth, 2 * math.pi)):.0f}°, elevation {math.degrees(elevation):.0f}°"
    )
