"""``fit --explain``: a web page of small images that shows the course of a fit."""

import html
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from PIL import Image, ImageDraw
from torch import Tensor

from core.fitting.explain import Explanation
from core.fitting.hypotheses import Hypothesis
from core.fitting.problem import FitJob
from core.fitting.steps import FitStep
from core.geometry.camera import Camera
from core.geometry.pixels import to_bytes
from core.models.codes import Codes
from core.models.model import Model
from core.photos.chair_box import EDGES
from core.photos.photo import Photo
from core.photos.segmentation import CutOut
from core.photos.view_bank import ViewBank
from core.rendering.images import render_image

_SMALL, _LARGE, _DETECTIONS = 80, 160, 480  # px of an image's side
_ZOOM = 1.6  # zoom of renders and photo, whose crops have wide margins
_SHOWN = 8  # hypotheses shown per stage
_STYLE = (
    "body{font:14px sans-serif;margin:2em;max-width:80em}figure{display:inline-block;margin:4px;vertical-align:top}"
    "figcaption{font-size:12px;text-align:center}td,th{padding:2px 10px;text-align:right}"
)


def write_page(model: Model, job: FitJob, found: Explanation, folder: Path, seen: Image.Image | None = None) -> Path:
    """Write ``index.html`` and its images into an existing folder; return the page's path.

    Args:
        seen: the first photo with its detections (:func:`draw_detections`).
    """
    page = folder / "index.html"
    sections = _Images(model, folder)
    body = "\n".join(
        f"<h2>{title}</h2>\n{''.join(parts)}"
        for title, parts in (
            ("What the detectors see", _detections(sections, found.categories, seen)),
            ("The photo and how it is cut out", _photo(sections, job.photos[0])),
            ("Where the search begins: the best views of the view bank", _candidates(sections, job.bank, found)),
            ("What each stage keeps: the least loss first", _stages(sections, found.stages)),
            ("The result, and the best hypothesis of another basin", _finalists(sections, job.photos[0], found)),
            ("Terms of the objective", _terms(found.terms)),
        )
    )
    head = f"<!doctype html><meta charset=utf-8><title>A fit explained</title><style>{_STYLE}</style>"
    page.write_text(f"{head}\n{body}\n", encoding="utf-8")
    return page


class _Images:
    """Images of a page, saved as numbered files beside it; methods return HTML."""

    def __init__(self, model: Model, folder: Path) -> None:
        self.model, self._folder, self._count = model, folder, 0

    def show(self, pixels: Float[Tensor, "height width 3"], caption: str, side: int = _SMALL) -> str:
        self._count += 1
        name = f"{self._count:02d}.png"
        Image.fromarray(to_bytes(pixels.cpu().clamp(0, 1).numpy())).save(self._folder / name)
        return f"<figure><img src={name} height={side}><figcaption>{html.escape(caption)}</figcaption></figure>"

    def render(self, codes: Codes, camera: Camera, caption: str, side: int = _SMALL) -> str:
        near = replace(camera.resized(side, side), focal=_ZOOM * camera.resized(side, side).focal)
        return self.show(render_image(self.model, codes, near).colour, caption, side)


def _middle(pixels: Float[Tensor, "height width channels"]) -> Float[Tensor, "less less_too channels"]:
    """Crop to the middle region that the zoomed renders show."""
    across, down = (round(side * (1 - 1 / _ZOOM) / 2) for side in pixels.shape[:2])
    return pixels[across : len(pixels) - across, down : pixels.shape[1] - down]


def _photo(images: _Images, photo: Photo) -> Iterator[str]:
    yield images.show(_middle(photo.pixels), "as it is fitted", _LARGE)
    opacity = photo.mask.float() if photo.opacity is None else photo.opacity
    yield images.show(_middle(opacity[..., None]).expand(-1, -1, 3), f"mask, edges ±{photo.edge_error:.1f} px", _LARGE)
    if photo.unseen is not None:
        unseen = _middle(photo.unseen[..., None].float())
        yield images.show(unseen.expand(-1, -1, 3), "not seen: beyond an edge", _LARGE)
    moved = "moved and scaled" if photo.scaled else "moved" if photo.cropped else "as it was"
    lens = "not known" if photo.focal is None else f"{photo.focal / len(photo.mask):.2f} image heights"
    yield f"<p>Its place in the image: {moved}. Focal length: {lens}. Blur: {photo.blur:.1f} px.</p>"


def draw_detections(image: Image.Image, cut: CutOut) -> Image.Image:
    """Draw the numbered boxes of chairs and cars, and a chair's 3D box, over a photo."""
    shown = Image.alpha_composite(Image.new("RGBA", image.size, "white"), image).convert("RGB")
    shown.thumbnail((_DETECTIONS, _DETECTIONS))
    pen = ImageDraw.Draw(shown)
    for number, one in enumerate(cut.detections, 1):
        left, top, right, bottom = (side * size for side, size in zip(one.box, shown.size * 2, strict=True))
        pen.rectangle((left, top, right, bottom), outline="lime")
        pen.text((left + 3, top + 2), f"{number}: {one.category} {one.score:.2f}", fill="lime", stroke_width=1)
    if cut.corners is not None:
        places = [tuple(corner) for corner in (cut.corners * shown.size).tolist()]
        for edge in EDGES:  # front edges are orange
            front = all((corner - 1) % 2 for corner in edge)
            pen.line([places[corner] for corner in edge], "orange" if front else "cyan", 2)
    return shown


def _detections(images: _Images, guess: dict[str, float], seen: Image.Image | None) -> Iterator[str]:
    if seen is not None:
        yield images.show(
            torch.from_numpy(np.asarray(seen) / 255), "boxes; of a 3D box the front is orange", _DETECTIONS
        )
    none = {"neither": 1 - sum(guess.values())} if guess else {}
    yield _table(("category", "probability"), ((name, f"{share:.2f}") for name, share in (guess | none).items()))


def _candidates(images: _Images, bank: ViewBank, found: Explanation) -> Iterator[str]:
    candidates = found.candidates
    if candidates is None:
        yield "<p>The camera was given.</p>"
        return
    for index, prototype in enumerate(candidates.prototype.tolist()):
        angles = float(candidates.azimuth[index]), float(candidates.elevation[index])
        caption = f"{_degrees(*angles)}, score {candidates.score[index]:.2f}"
        yield images.render(
            Codes(bank.codes.shape[prototype], bank.codes.texture[prototype]), images.model.camera(*angles), caption
        )


def _stages(images: _Images, stages: Sequence[FitStep]) -> Iterator[str]:
    for stage in stages:
        yield f"<h3>Step {stage.step}, {'second' if stage.restart else 'first'} search, {stage.active} optimised</h3>"
        yield from (_hypothesis(images, one) for one in stage.hypotheses[:_SHOWN])


def _finalists(images: _Images, photo: Photo, found: Explanation) -> Iterator[str]:
    last = found.stages[-1]
    yield images.show(_middle(photo.pixels), "photo", _LARGE)
    yield from (_hypothesis(images, one, _LARGE) for one in last.hypotheses[:2])
    confidence = "not known" if last.confidence is None else f"{last.confidence:.2f}"
    margin = "not known" if last.margin is None else f"{last.margin:.2f}"
    off = "not known" if last.uncertainty is None else f"{last.uncertainty:.1f}°"
    told = "" if photo.direction is None else f" The 3D box tells {_degrees(*photo.direction)}."
    yield f"<p>Confidence {confidence}: margin (logarithm) {margin}, uncertainty {off}, {last.psnr:.1f} dB.{told}</p>"


def _hypothesis(images: _Images, one: Hypothesis, side: int = _SMALL) -> str:
    camera = one.cameras[0]
    caption = f"#{one.origin}, {_degrees(camera.azimuth, camera.elevation)}, loss {one.loss:.4f}"
    return images.render(one.codes, camera, caption, side)


def _terms(columns: Sequence[dict[str, float]]) -> Iterator[str]:
    heads = ("term", "result", "other basin")[: 1 + len(columns)]
    yield _table(heads, ((name, *(f"{column[name]:.5f}" for column in columns)) for name in columns[0]))


def _degrees(azimuth: float, elevation: float) -> str:
    return f"{math.degrees(azimuth) % 360:.0f}°, {math.degrees(elevation):.0f}°"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f"<tr>{''.join(f'<th>{head}</th>' for head in heads)}</tr>"]
    lines += [f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>" for row in rows]
    return f"<table>{''.join(lines)}</table>"
