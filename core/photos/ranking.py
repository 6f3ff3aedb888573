"""Candidate cameras for a photo: the views of the view bank ranked by how well they match it."""

import math
from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int, Int8, UInt8
from torch import Tensor
from torch.nn import functional

from core.classifiers.viewpoint import AZIMUTHS
from core.geometry.camera import camera_rotation
from core.geometry.pixels import bounding_box
from core.photos.view_bank import SIDE, ViewBank, normalised_luminance, unpack_bits

_SIZE_WEIGHT, _PLACE_WEIGHT = 0.3, 1.0
"""of a difference in size (logarithm) and in place (object sizes), against the overlap"""
_LUMINANCE_WEIGHT = 0.1
"""of the correlation of luminance, against the overlap: textures are unknown yet, so it settles ties only"""
_VIEWPOINT_RANK_WEIGHT = 0.06  # of the logarithm of a direction's probability, against the overlap
_NEIGHBOURS = 20  # best matching views that say where an object should lie
_MATCHED = 1344  # views at a time, as the bank's numbers take more memory in the format that is computed in
_TRUNCATION = (0.0, 0.25, 0.6)
"""How much of an object may lie beyond an edge that cuts it off, as shares of what is seen of it."""


class ObjectImage(NamedTuple):
    """An image of one object, and where the object is on it."""

    pixels: Float[Tensor, "height width 3"]  # on white, 0..1
    mask: Bool[Tensor, "height width"]  # True on the object; anything on it at all
    focal: float  # px
    unseen: Bool[Tensor, "height width"] | None = None  # True where nothing was seen, as an edge cuts the object off


class CandidateCameras(NamedTuple):
    """Cameras to begin from, best first."""

    azimuth: Float[Tensor, "cameras"]
    elevation: Float[Tensor, "cameras"]
    distance: Float[Tensor, "cameras"]
    shift: Float[Tensor, "cameras 2"]  # from where the prototype lies to where the image's object does; focal lengths
    prototype: Int[Tensor, "cameras"]  # the prototype of the view bank that matches the image best from there
    score: Float[Tensor, "cameras"]  # the overlap with it, less what differs in size and place, more what is probable


def rank_cameras(
    bank: ViewBank,
    image: ObjectImage,
    count: int,
    viewpoint: Float[Tensor, "views"] | None = None,
    cropped: bool = False,
) -> CandidateCameras:
    """The ``count`` best matching cameras for an image, or as many as there are so far apart, every second one seen
    from the opposite side of the one before.

    Args:
        viewpoint: how probable every direction is, as :func:`core.classifiers.viewpoint.predict_viewpoint` has it.
        cropped: the image was moved and perhaps scaled: size and place in it do not count.

    Raises ``ValueError`` for an empty bank.
    """
    bank.require_prototypes()
    templates = _templates(image)
    scores = _match(bank.silhouettes, bank.luminance, bank.contrast, templates)
    sizes = torch.tensor([template.size for template in templates])
    middles = torch.stack([template.middle for template in templates])
    if not cropped:
        size = sizes[:, None, None]
        offset = (bank.offsets - middles[:, None, None]).norm(dim=-1)
        scores = scores - _SIZE_WEIGHT * (bank.sizes / size).log().abs() - _PLACE_WEIGHT * offset / size
    best, which = scores.flatten(0, 1).max(0)
    if viewpoint is not None:
        best = best + _VIEWPOINT_RANK_WEIGHT * viewpoint.log()
    chosen = _spaced_out(best, count)
    template, prototype = which[chosen] // len(bank.sizes), which[chosen] % len(bank.sizes)
    scale = sizes[template] / bank.sizes[prototype, chosen]
    distance = (bank.distance / scale).clamp(0.5 * bank.distance, 2 * bank.distance)
    shift = middles[template] - bank.offsets[prototype, chosen] * scale[:, None]
    return CandidateCameras(bank.azimuth[chosen], bank.elevation[chosen], distance, shift, prototype, best[chosen])


def shape_similarity(
    bank: ViewBank, image: ObjectImage, azimuth: float, elevation: float
) -> Float[Tensor, "prototypes"]:
    """How well each prototype matches an image of known camera (rad), from the view bank's view nearest to it."""
    given = camera_rotation(torch.tensor(azimuth), torch.tensor(elevation))
    nearest = (camera_rotation(bank.azimuth, bank.elevation) * given).sum((-2, -1)).argmax()
    views = bank.silhouettes[:, nearest], bank.luminance[:, nearest], bank.contrast[:, nearest]
    return _match(*views, _templates(image)).amax(0)


def offset_from_expected(bank: ViewBank, image: ObjectImage) -> float:
    """How far an object lies, in focal lengths, from where any of the views that match it best would lie.

    Below 0.02 in 476 of 480 images of the training kind, and above in all of the same moved by a tenth.
    """
    template = _template(image._replace(unseen=None), bounding_box(image.mask))
    scores = _match(bank.silhouettes, bank.luminance, bank.contrast, [template])
    best = scores.flatten().topk(_NEIGHBOURS).indices
    expected = (bank.offsets * (template.size / bank.sizes)[..., None]).flatten(0, 1)[best]
    return float((expected - template.middle).norm(dim=-1).min())


def expected_scales(bank: ViewBank, image: ObjectImage) -> Float[Tensor, "views"]:
    """From every direction, the logarithm of how much larger an image shows its object than objects are seen."""
    left, top, right, bottom = bounding_box(image.mask)
    return math.log(max(right - left, bottom - top) / image.focal) - bank.sizes.log().median(0).values


class _Template(NamedTuple):
    """An image on the view bank's grid, if the whole object fills some box in it."""

    mask: Float[Tensor, "side side"]
    luminance: Float[Tensor, "side side"]
    seen: Float[Tensor, "side side"]  # 0 where the image says nothing
    size: float  # the box's longer side, in focal lengths
    middle: Float[Tensor, "2"]  # of the box less that of the image, (x, y) in focal lengths


def _templates(image: ObjectImage) -> list[_Template]:
    """The image as it is; where an edge cuts the object off, also as it is if more or less lies beyond it."""
    unseen = torch.zeros_like(image.mask) if image.unseen is None else image.unseen
    left, top, right, bottom = bounding_box(image.mask)
    edges = unseen[:, 0].all(), unseen[0].all(), unseen[:, -1].all(), unseen[-1].all()
    sides = [_TRUNCATION if edge else _TRUNCATION[:1] for edge in edges]
    across, down = right - left, bottom - top
    boxes = [
        (left - one * across, top - two * down, right + three * across, bottom + four * down)
        for one, two, three, four in product(*sides)
    ]
    return [_template(image, box) for box in boxes]


def _template(image: ObjectImage, box: tuple[float, ...]) -> _Template:
    left, top, right, bottom = box
    height, width = image.mask.shape
    size = max(bottom - top, right - left)
    # A grid over the square around the box, widened by the view bank's margin of one pixel a side.
    reach = size * SIDE / (SIDE - 2)
    steps = (torch.arange(SIDE * 3) + 0.5) / (SIDE * 3) - 0.5
    y = ((top + bottom) / 2 + steps * reach) / height * 2 - 1
    x = ((left + right) / 2 + steps * reach) / width * 2 - 1
    grid = torch.stack(torch.broadcast_tensors(x[None, :], y[:, None]), -1)[None]
    both = torch.stack((image.mask.float(), image.pixels.mean(-1) * image.mask), 0)[None].float()
    cover, luminance = functional.avg_pool2d(functional.grid_sample(both, grid, "bilinear", "zeros", False), 3)[0]
    known = torch.ones_like(image.mask) if image.unseen is None else ~image.unseen
    seen = functional.avg_pool2d(functional.grid_sample(known[None, None].float(), grid, "nearest", "border", False), 3)
    middle = torch.tensor([left + right - width, top + bottom - height]) / (2 * image.focal)
    luminance = normalised_luminance(luminance / cover.clamp_min(1e-3), cover)
    return _Template(cover, luminance, seen[0, 0], size / image.focal, middle)


def _match(
    silhouettes: UInt8[Tensor, "*views bytes"],
    luminance: Int8[Tensor, "*views pixels"],
    contrast: Float[Tensor, "*views"],
    templates: Sequence[_Template],
) -> Float[Tensor, "templates *views"]:
    """Overlap of the masks (intersection over union) where the image is seen, and a share of the correlation of
    luminance.
    """
    mask, light, seen = (
        torch.stack([getattr(template, part).flatten() for template in templates], 1)
        for part in ("mask", "luminance", "seen")
    )
    scores = []
    for packed, values, factor in zip(
        *(part.split(_MATCHED) for part in (silhouettes.flatten(0, -2), luminance.flatten(0, -2), contrast.flatten())),
        strict=True,
    ):
        views = unpack_bits(packed)
        shared = views @ mask
        overlap = shared / (views @ seen + mask.sum(0) - shared)
        scores.append(overlap + _LUMINANCE_WEIGHT * factor[:, None] * (values.float() @ light))
    return torch.cat(scores).T.reshape(len(templates), *contrast.shape)


def _spaced_out(scores: Float[Tensor, "views"], count: int) -> Int[Tensor, "count"]:
    """Views in order of their scores, none beside one taken before, each followed by its opposite (azimuth + 180)."""
    remaining, taken = scores.clone(), list[int]()
    half = AZIMUTHS // 2
    while len(taken) < count and bool(torch.isfinite(remaining).any()):
        view = int(remaining.argmax())
        row, column = divmod(view, AZIMUTHS)
        for azimuth in (column, (column + half) % AZIMUTHS):
            if torch.isfinite(remaining[row * AZIMUTHS + azimuth]):
                taken.append(row * AZIMUTHS + azimuth)
            beside = [row * AZIMUTHS + (azimuth + step) % AZIMUTHS for step in (-1, 0, 1)]
            remaining[beside] = -math.inf
    return torch.tensor(taken[:count])
