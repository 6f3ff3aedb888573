"""Borrow the front or rear that no photo shows from the most similar training object.

Codes say little about places that no photo shows: lamps, plate and bumper come out as one blur. Pictures of some
training objects' meshes, from ahead and from behind, ship with the program (``assets/borrowed``, a folder of each
category, named like the objects in the model's codes). The picture of the object with the most similar shape is warped
so that outlines and windows coincide with those of the fitted object's render, takes its paint and lends its edges.
"""

import math
from collections.abc import Collection, Generator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from core.detail.filters import blurred, continued, distance, enlarged, levels, resized
from core.detail.lookup import ColourMatch, DetailMaps, PhotoMaps, packed, smooth_step
from core.detail.surface import SurfaceTexels, surface_normals, surface_texels
from core.geometry.camera import Camera
from core.geometry.rays import camera_rays
from core.models.model import Instance, Model
from core.models.network import with_network
from core.models.photo_detail import MAX_PHOTOS
from core.rendering.folded_layers import batch_density
from core.rendering.images import render_steps
from core.rendering.reference import Rendered
from core.runtime.caches import Cached
from core.runtime.modes import usual_settings
from core.runtime.reading import open_image, reading

FOLDER = Path(__file__).resolve().parents[2] / "assets" / "borrowed"
SIDE = 384  # px of a picture
ENDS = math.pi / 2, -math.pi / 2  # azimuths of the two rows of pictures in a file: from ahead, from behind
_ELEVATION = math.radians(12)
_ZOOM = 1.9  # of the model's focal length: the largest car fills the picture
_SIZE = 256  # px of the render, to whose surface a picture is warped
_SAMPLES = 192
_GRID = 20  # points along each side of the box at which shapes are compared
_DENSE = 20.0  # density per scene unit inside an object: transmits a third over a cell of that grid
_SHOWN = 0.9, 0.4  # share of colours from photos and their mirror images: nothing is borrowed above the first
_FACED = math.cos(math.radians(55))  # of the angle to an end's camera, within which a photo shows the end
_MOSTLY = 0.5  # mean of that share on an end, above which nothing is borrowed for the end
_FADE = 1.0, 5.0  # px from the outline over which borrowed colours begin
_BODY = 0.3, 0.7  # probability of paint and trim: panes and wheels are the model's
_PANE = 0.6, 0.3  # the same of panes in a picture, which belong on no body
_ROWS = 9  # over which the widths of outlines are averaged
_WIDEN = 0.6, 1.7  # limits of the change of a row's width
_SMOOTH = 5.0  # px, standard deviation: colours of larger areas are the model's
_CONTRAST = 0.6  # of borrowed edges: at 1, those in the wrong place cost more PSNR than the others gain


class Picture(NamedTuple):
    """An end of a training object, from ahead or from behind."""

    colour: Float[Tensor, "3 h w"]  # with black paint, on white
    paint: Float[Tensor, "h w"]  # 0..1, the lightness that white paint adds
    opacity: Float[Tensor, "h w"]
    glass: Float[Tensor, "h w"]  # 0..1


@dataclass(frozen=True, eq=False)
class BorrowedEnd(Cached):
    """A picture warped to the fitted object, with the surface it lies on. Not modified after creation."""

    camera: Camera
    colour: Float[Tensor, "3 height width"]  # with black paint
    paint: Float[Tensor, "height width"]  # lightness relative to the paint's in even light
    weight: Float[Tensor, "h w"]  # 0..1, zero where photos give colours
    plain: Bool[Tensor, "h w"]  # places with paint
    surface: Float[Tensor, "4 h w"]  # as :attr:`core.detail.lookup.PhotoMaps.surface`
    texels: SurfaceTexels

    def maps(self, textured: Instance, match: ColourMatch) -> PhotoMaps:
        """Return the maps of the end in an object's texture, for the pass of mirror images only.

        Large areas keep the model's colours; the picture adds its edges. A mirrored object's picture is mirrored: seen
        in a mirror, the end is where it belongs.

        Args:
            match: of the model's colours to the photos'.
        """
        fitted_colour = self.texels.colours(textured)
        fitted_colour = (fitted_colour + match.change(fitted_colour.movedim(0, -1)).movedim(-1, 0)).clamp(0, 1)
        paint = fitted_colour[:, self.plain].median(1).values[:, None, None]
        colour = (self.colour * (1 - self.paint).clamp_min(0) + self.paint * paint).clamp(0, 1)
        inside = (self.weight > 0).float()[None]
        smooth = blurred(torch.cat((fitted_colour * inside, resized(colour, self.weight) * inside, inside)), _SMOOTH)
        even, blur = enlarged(smooth[:6] / smooth[6:].clamp_min(1e-3), colour).split(3)
        colour = (even + _CONTRAST * (colour - blur)).clamp(0, 1)
        weight = enlarged(self.weight[None], colour)
        device = textured.model.device
        mirrored = levels(torch.cat((colour, packed(weight, (weight > 0).float()))).flip(-1), device)
        surface = (self.surface * torch.tensor([-1.0, 1, 1, 1])[:, None, None]).flip(-1).to(device)
        return PhotoMaps(self.camera, tuple(map(torch.zeros_like, mirrored)), mirrored, surface)


def borrowed_ends(fitted: Instance, photos: Sequence[PhotoMaps]) -> Generator[None, None, tuple[BorrowedEnd, ...]]:
    """Return the ends that photos and their mirror images mostly do not show; yields None many times.

    As many as there is room for beside the photos; none for models without pictures of training objects.
    """
    ends = list[BorrowedEnd]()
    pictures = pictured(fitted.model)
    if not pictures:
        return ()
    source = most_similar(fitted, pictures)
    for number, azimuth in enumerate(ENDS):
        faced = any(math.sin(photo.camera.azimuth) * math.sin(azimuth) > _FACED for photo in photos)
        if not faced and len(photos) + len(ends) < MAX_PHOTOS:
            camera = end_camera(fitted.model, azimuth)
            rendered = yield from render_steps(fitted, camera.resized(_SIZE, _SIZE), _SAMPLES)
            yield None
            with torch.inference_mode():
                end = _borrowed(fitted, camera, rendered, photos, read_pictures(pictures[source])[number])
            ends += [end] if end else []
    return tuple(ends)


def end_camera(model: Model, azimuth: float) -> Camera:
    """Return the camera of the pictures from one of :data:`ENDS`."""
    camera = model.camera(azimuth, _ELEVATION)
    return replace(camera, width=SIDE, height=SIDE, focal=model.focal * SIDE / model.image_size * _ZOOM)


@lru_cache(maxsize=4)
def pictured(model: Model) -> dict[int, Path]:
    """Return the training objects that have pictures, by number."""
    files = {path.stem: path for path in (FOLDER / model.category).glob("*.webp")} if model.category else {}
    return {number: files[entry.name] for number, entry in enumerate(model.codes.objects) if entry.name in files}


@lru_cache(maxsize=4)
def read_pictures(path: Path) -> tuple[Picture, ...]:
    """Return a training object's pictures, in the order of :data:`ENDS`. Raises ``ValueError`` for another file.

    A row of the file is a picture: colours, paint, opacity and glass beside each other.
    """
    with reading(path, "pictures of a training object"), open_image(path) as image:
        pixels = np.asarray(image.convert("RGB"), np.float32) / 255
        if pixels.shape != (len(ENDS) * SIDE, 4 * SIDE, 3):
            raise ValueError(f"pictures are {4 * SIDE} x {len(ENDS) * SIDE} px")
    pictures = []
    for row in np.split(pixels, len(ENDS)):
        colour, *masks = torch.from_numpy(row.copy()).movedim(-1, 0).split(SIDE, 2)
        paint, opacity, glass = (mask.mean(0) for mask in masks)
        pictures.append(Picture(continued(colour, opacity > 0.95), paint, opacity, glass))
    return tuple(pictures)


def most_similar(fitted: Instance, pictures: Collection[int]) -> int:
    """Return the training object whose occupied space overlaps the fitted object's most."""
    numbers = tuple(pictures)
    shapes = _occupied_by_training_objects(fitted.model, numbers)
    occupied = _occupied(with_network(fitted.model, fitted.codes), fitted.biases[0][None])
    overlap = (occupied & shapes).sum(1) / (occupied | shapes).sum(1).clamp_min(1)
    return numbers[int(overlap.argmax())]


@lru_cache(maxsize=2)
def _occupied_by_training_objects(model: Model, numbers: tuple[int, ...]) -> Bool[Tensor, "objects points"]:
    with usual_settings():  # cached
        return _occupied(model, torch.stack([model[number].biases[0] for number in numbers]))


@torch.no_grad()
def _occupied(model: Model, shape_bias: Float[Tensor, "objects blocks width"]) -> Bool[Tensor, "objects points"]:
    """Return which points of a regular grid lie inside objects."""
    axis = torch.linspace(-1, 1, _GRID, device=model.device)
    points = torch.cartesian_prod(axis, axis, axis) * model.extent_tensor
    cells = None if model.occupied_cells is None else model.occupied_cells[None].to(model.device)
    return batch_density(model, points.expand(len(shape_bias), -1, -1), shape_bias, cells) > _DENSE


def _borrowed(
    fitted: Instance, camera: Camera, rendered: Rendered, photos: Sequence[PhotoMaps], picture: Picture
) -> BorrowedEnd | None:
    """Warp a picture to a render of the same end; None if photos show the end, or either object exceeds its image."""
    small = camera.resized(_SIZE, _SIZE)
    rendered = Rendered(rendered.colour.cpu(), rendered.depth.cpu(), rendered.opacity.cpu())
    rays = camera_rays(small, torch.tensor(fitted.model.extent))
    solid = rendered.opacity > 0.5
    # Neither may be empty or reach the border of its image.
    if not all(0 < int(mask[1:-1, 1:-1].sum()) == int(mask.sum()) for mask in (solid, picture.opacity > 0.5)):
        return None
    shares = DetailMaps(tuple(photos)).added(rendered, small)[1]
    coverage = (sum(shares) / rendered.opacity.clamp_min(1e-3)).clamp(0, 1)  # by photos and their mirror images
    if float(coverage[solid].mean()) > _MOSTLY:
        return None
    texels, parts = surface_texels(fitted, rays, rendered)
    normals = surface_normals(rays, rendered)
    panes = parts.get("glass", torch.zeros_like(rendered.opacity))
    grid = _warp(solid, panes, picture)
    colour = functional.grid_sample(picture.colour[None], grid[None], align_corners=False)[0]
    masks = torch.stack((picture.paint, picture.glass))
    paint, glass = functional.grid_sample(masks[None], grid[None], align_corners=False)[0]
    small_paint, small_glass = functional.adaptive_avg_pool2d(torch.stack((paint, glass))[None], _SIZE)[0]
    body = 1 - panes - parts.get("wheels", torch.zeros_like(panes))
    edge = smooth_step(distance(solid), *_FADE)
    weight = edge * smooth_step(body, *_BODY) * smooth_step(small_glass, *_PANE)
    weight = blurred(weight[None], 1.0)[0] * smooth_step(coverage, *_SHOWN) * (weight > 0)
    plain = (small_paint > 0.35) & (weight > 0.5)
    if not bool(plain.any()):
        return None
    paint = paint / small_paint[plain].median()
    surface = torch.cat((normals, rendered.depth[..., None]), -1).movedim(-1, 0)
    return BorrowedEnd(camera, colour, paint, weight, plain, continued(surface, solid), texels)


def _warp(solid: Bool[Tensor, "h w"], glass: Float[Tensor, "h w"], picture: Picture) -> Float[Tensor, "height width 2"]:
    """Return places in a picture (-1..1) for each pixel of the fitted object's end, at the picture's size.

    Top, window and bottom coincide, and in each row the left and the right outline. The object's plane of symmetry is
    the middle of the image.
    """
    solid, glass = functional.interpolate(torch.stack((solid.float(), glass))[None], SIDE, mode="bilinear")[0]
    own_rows = _rows(solid, glass)
    picture_rows = _rows(picture.opacity, picture.glass)
    if len(own_rows) != len(picture_rows):
        own_rows, picture_rows = ((rows[0], rows[-1]) for rows in (own_rows, picture_rows))
    rows = np.interp(np.arange(SIDE), own_rows, picture_rows)
    widths, pictured_widths = (_widths(mask) for mask in (solid, picture.opacity))
    scale = np.clip(np.interp(rows, np.arange(SIDE), pictured_widths) / np.maximum(widths, 4), *_WIDEN)
    coordinates = (np.arange(SIDE) + 0.5) * 2 / SIDE - 1
    down = np.broadcast_to((rows[:, None] + 0.5) * 2 / SIDE - 1, (SIDE, SIDE))
    return torch.from_numpy(np.stack((scale[:, None] * coordinates, down), -1)).float()


def _rows(mask: Float[Tensor, "h w"], glass: Float[Tensor, "h w"]) -> tuple[int, ...]:
    """Return the rows of an end's top and bottom, and of its window's between them if it has one."""
    inside = ((mask > 0.5).sum(1) > 2).nonzero()[:, 0]
    middle = slice(SIDE // 2 - SIDE // 16, SIDE // 2 + SIDE // 16)
    pane = (glass[:, middle].mean(1) > 0.5).nonzero()[:, 0]
    window = (int(pane[0]), int(pane[-1])) if len(pane) > SIDE // 48 else ()
    return int(inside[0]), *window, int(inside[-1])


def _widths(mask: Float[Tensor, "h w"]) -> Float[np.ndarray, "h"]:
    """Return the width of each row of a mask, averaged over neighbouring rows."""
    widths = (mask > 0.5).float().sum(1)[None, None]
    padded = functional.pad(widths, (_ROWS // 2,) * 2, mode="replicate")
    return functional.avg_pool1d(padded, _ROWS, 1)[0, 0].numpy()
