"""The paper's figures of one's own photos: progress of a fit, shapes times textures, interpolation, and edits.

Photos are fitted without their cameras. Every figure is one image; rows and columns are labelled.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw
from torch import Tensor
from torch.nn import functional

from core.fitting.fit import FitJob, FitStep, fit
from core.fitting.settings import PRESETS
from core.geometry.camera import Camera
from core.lab.benchmarks.held_out_views import render_on_white
from core.models.codes import Codes
from core.models.model import Model
from core.photos.photo import Photo
from core.photos.view_bank import ViewBank

_SIDE, _LABEL = 160, 18  # px: an image in a figure, and the line of text above it
_STRIP_STEPS = 8  # renders of a fit over time
_SHARES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)  # fractions of the way from the first object to the second
_TURN = math.radians(60)  # between the photo's viewpoint and another

Cell = tuple[str, UInt8[Tensor, "side side 3"]]  # a label and an image


@dataclass(frozen=True, eq=False)
class FittedPhoto:
    """A photo and the steps of its fit."""

    photo: Photo
    steps: tuple[FitStep, ...]

    @property
    def codes(self) -> Codes:
        """The fitted codes, without photo detail."""
        return replace(self.steps[-1].codes, detail=None)


def fit_photo(model: Model, bank: ViewBank, photo: Photo, seed: int = 0) -> FittedPhoto:
    """Fit a photo with the preset ``normal``. Raise ``ValueError`` as :func:`core.fitting.fit.fit` does."""
    return FittedPhoto(photo, tuple(fit(model, FitJob((photo,), bank, PRESETS["normal"], seed))))


def write_figures(model: Model, fitted: Sequence[FittedPhoto], folder: Path) -> Iterator[Path]:
    """Write ``fit.png``, ``edited.png`` and, of two or more photos, ``grid.png`` and ``interpolation.png``.

    Yield each path once it is written. Raise ``ValueError`` if there is no photo.
    """
    if not fitted:
        raise ValueError("there is no photo to draw figures of")
    folder.mkdir(parents=True, exist_ok=True)
    figures = {"fit": [_strip(model, one) for one in fitted], "edited": [_edits(model, fitted, one) for one in fitted]}
    if len(fitted) > 1:
        figures |= {"grid": _grid(model, fitted), "interpolation": _interpolation(model, *fitted[:2])}
    for name, rows in figures.items():
        labelled_sheet(rows).save(folder / f"{name}.png")
        yield folder / f"{name}.png"


def _strip(model: Model, one: FittedPhoto) -> list[Cell]:
    """Return the photo, then the leading hypothesis after more and more steps."""
    last = len(one.steps) - 1
    chosen = [round((last + 1) ** (index / (_STRIP_STEPS - 1))) - 1 for index in range(_STRIP_STEPS)]
    return [_of_photo(one.photo)] + [
        (f"step {step.step}, {step.psnr:.1f} dB", _of_codes(model, step.codes, step.cameras[0]))
        for step in (one.steps[index] for index in sorted({*chosen}))
    ]


def _edits(model: Model, fitted: Sequence[FittedPhoto], one: FittedPhoto) -> list[Cell]:
    """Return the photo, its fit, and edits of one of viewpoint, texture and shape.

    Codes come from the next photo; from the training object least like it if there is only one photo.
    """
    camera, codes = one.steps[-1].cameras[0], one.codes
    following = fitted[(fitted.index(one) + 1) % len(fitted)].codes if len(fitted) > 1 else _unlike(model, codes)
    turned = replace(camera, azimuth=camera.azimuth + _TURN)
    return [
        _of_photo(one.photo),
        ("fitted", _of_codes(model, codes, camera)),
        ("other viewpoint", _of_codes(model, codes, turned)),
        ("other texture", _of_codes(model, Codes(codes.shape, following.texture), camera)),
        ("other shape", _of_codes(model, Codes(following.shape, codes.texture), camera)),
    ]


def _unlike(model: Model, codes: Codes) -> Codes:
    valid = model.codes.valid
    distance = torch.stack([(model.codes[index].shape - codes.shape).norm() for index in valid])
    return model.codes[valid[int(distance.argmax())]]


def _grid(model: Model, fitted: Sequence[FittedPhoto]) -> list[list[Cell]]:
    """Return every shape, row by row, with every texture, from the first photo's viewpoint."""
    camera, blank = fitted[0].steps[-1].cameras[0], torch.full((_SIDE, _SIDE, 3), 255, dtype=torch.uint8)
    head = [("", blank), *(_of_photo(one.photo, f"texture {number}") for number, one in enumerate(fitted, 1))]
    rows = [
        [_of_photo(one.photo, f"shape {number}")]
        + [("", _of_codes(model, Codes(one.codes.shape, other.codes.texture), camera)) for other in fitted]
        for number, one in enumerate(fitted, 1)
    ]
    return [head, *rows]


def _interpolation(model: Model, first: FittedPhoto, second: FittedPhoto) -> list[list[Cell]]:
    """Return interpolations between the photos' codes: of shape, of texture, of both."""
    camera = first.steps[-1].cameras[0]
    rows = []
    for name, shape, texture in (("shape", 1, 0), ("texture", 0, 1), ("both", 1, 1)):
        between = [first.codes.mixed(second.codes, share * shape, share * texture) for share in _SHARES]
        labels = [f"{name}, {100 * share:.0f} %" for share in _SHARES]
        cells = [(label, _of_codes(model, codes, camera)) for label, codes in zip(labels, between, strict=True)]
        rows.append([_of_photo(first.photo), *cells, _of_photo(second.photo)])
    return rows


def _of_photo(photo: Photo, label: str = "photo") -> Cell:
    return to_cell(label, photo.pixels)


def _of_codes(model: Model, codes: Codes, camera: Camera) -> UInt8[Tensor, "side side 3"]:
    return _bytes(render_on_white(model, codes, camera)[0])


def to_cell(label: str, colour: Float[Tensor, "height width 3"]) -> Cell:
    """Return a cell of :func:`labelled_sheet`; colours 0..1."""
    return label, _bytes(colour)


def _bytes(colour: Float[Tensor, "height width 3"]) -> UInt8[Tensor, "side side 3"]:
    """Return the image on a white square ``_SIDE`` px wide."""
    height, width = colour.shape[:2]
    side = max(height, width)
    left, top = (side - width) // 2, (side - height) // 2
    square = functional.pad(
        colour.float().cpu().permute(2, 0, 1), (left, side - width - left, top, side - height - top), value=1.0
    )
    sized = functional.interpolate(square[None], (_SIDE, _SIDE), mode="bilinear", antialias=True)[0]
    return (255 * sized.permute(1, 2, 0).clamp(0, 1) + 0.5).byte()


def labelled_sheet(rows: Sequence[Sequence[Cell]]) -> Image.Image:
    """Return one image of all cells, row by row, with a line of text above each."""
    columns = max(map(len, rows))
    sheet = Image.new("RGB", (columns * _SIDE, len(rows) * (_SIDE + _LABEL)), "white")
    draw = ImageDraw.Draw(sheet)
    for row, cells in enumerate(rows):
        for column, (label, image) in enumerate(cells):
            left, top = column * _SIDE, row * (_SIDE + _LABEL)
            draw.text((left + 4, top + 3), label, "black")
            sheet.paste(Image.fromarray(image.numpy()), (left, top + _LABEL))
    return sheet
