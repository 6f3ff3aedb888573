"""Fitted photos as photo detail: at full resolution, upright, with the optical axis in the middle."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from core.fitting.hypotheses import Hypothesis
from core.fitting.problem import nominal_camera
from core.fitting.steps import FitStep
from core.geometry.camera import Camera
from core.geometry.pixels import bounding_box, to_bytes
from core.models.codes import Codes
from core.models.model import Instance, Model
from core.models.photo_detail import BACKGROUND, MAX_PHOTOS, PhotoDetail, PhotoView, decompressed
from core.photos.photo import DOUBTFUL_MASK, Photo
from core.rendering.images import render_steps
from core.streams import run_to_end

_MARGIN = 0.2 / 128  # image heights added to the edge error for the margin within which the object ends
_DOUBTFUL_OPACITY = round(2 * BACKGROUND * 255)  # 0..255, of doubtful background; certain background has less
_RENDER_HEIGHT = 64  # px, height of the render that the mask is compared with
_SAME_OPACITY = 0.02  # difference up to which an opacity counts as that of doubtful background
_KEPT_CONFIDENCE = 0.9  # mask confidence of a photo kept with an object, which does not record its own
_SOLID = 0.9  # opacity of the render above which the fitted object is solid
_DEEP_BACKGROUND = 6 / 128  # image heights from the mask; nearer background is certain, the render is less exact


def with_photo_detail(photos: Sequence[Photo], step: FitStep) -> FitStep:
    """Return a step with photo detail; a completed search has it already."""
    hypothesis = replace(step.hypotheses[0], instance=step.instance)
    return replace(step, instance=detailed_instance(photos, hypothesis, step.left_out))


def detailed_instance(photos: Sequence[Photo], hypothesis: Hypothesis, left_out: Sequence[int] = ()) -> Instance:
    """Return the instance of a hypothesis with photo detail from the first :data:`MAX_PHOTOS` photos.

    Only a single photo's mask bounds the object: each of several cuts off what the errors of the others' cameras move.

    Args:
        left_out: numbers of photos that are skipped.
    """
    plain = hypothesis.instance.with_detail(None)
    fitted = zip(photos, hypothesis.cameras, hypothesis.crop_transform, strict=True)
    included = [photo_and_camera for number, photo_and_camera in enumerate(fitted) if number not in left_out]
    views = tuple(
        photo_view(plain.model, photo, camera, None if photo.camera else transform, plain)
        for photo, camera, transform in included[:MAX_PHOTOS]
    )
    if len(included) > 1:
        views = tuple(replace(view, outline_margin=None) for view in views)
    return plain.with_detail(PhotoDetail.of(views, plain.codes))


def resume_point(instance: Instance) -> tuple[tuple[Photo, ...], Hypothesis]:
    """Return the photos of an object's detail, and the hypothesis with which a fit of them and of others begins.

    Edits of the object are left out. Raises ``ValueError`` for an object without photos.
    """
    if instance.detail is None:
        raise ValueError("the object has no photos: fit it from all of them")
    model = instance.model
    photos = tuple(_kept_photo(view, model) for view in instance.detail.views)
    views = zip(instance.detail.views, photos, strict=True)
    cameras = tuple(view.camera.resized(*reversed(photo.mask.shape)) for view, photo in views)
    transform = torch.zeros(len(cameras), 4)
    scales = [camera.focal / nominal_camera(photo, model).focal for camera, photo in zip(cameras, photos, strict=True)]
    transform[:, 0] = torch.tensor(scales).log()
    latents = instance.detail.fitted
    codes = Codes(latents.shape, latents.texture, latents.shape_offsets, latents.texture_offsets)
    return photos, Hypothesis(0, 0.0, cameras, Instance(model, codes), transform)


def _kept_photo(view: PhotoView, model: Model) -> Photo:
    """Return a photo of an object's detail, prepared for a fit."""
    import cv2  # loaded only if there is a photo

    rgba = view.pixels()
    scale = model.image_size / max(rgba.shape[:2])
    size = tuple(max(1, round(scale * side)) for side in rgba.shape[1::-1])
    pixels = torch.from_numpy(cv2.resize(rgba, size, interpolation=cv2.INTER_AREA) / 255).float()
    opacity = pixels[..., 3]
    mask = opacity > 0.5
    # The object may be hidden where its background is doubtful.
    unseen = ~mask & ((opacity - 2 * BACKGROUND).abs() < _SAME_OPACITY)
    return Photo(
        pixels[..., :3],
        mask,
        cropped=True,
        unseen=unseen,
        scaled=True,
        opacity=opacity * ~unseen,
        fine=view.image,
        mask_confidence=_KEPT_CONFIDENCE,
    )


def photo_view(
    model: Model,
    photo: Photo,
    camera: Camera,
    crop_transform: Float[Tensor, "4"] | None = None,
    fitted: Instance | None = None,
) -> PhotoView:
    """Return a photo as the camera sees the object; doubtful background gets a low opacity.

    Args:
        camera: fitted to the photo, or its own.
        crop_transform: see :class:`core.fitting.hypotheses.Parameters`; None: identity.
        fitted: the object fitted to the photo. Background is doubtful where it is solid deep in it.
    """
    import cv2  # loaded only if there is a photo

    rgba = photo_pixels(photo)
    height, width = rgba.shape[:2]
    if photo.unseen is not None:
        unseen = cv2.resize(photo.unseen.numpy().astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
        rgba[..., 3] = np.maximum(rgba[..., 3], _DOUBTFUL_OPACITY * unseen)
    if crop_transform is not None and bool(crop_transform[1:].any()):
        _, roll, *shift = crop_transform.tolist()
        focal = model.focal * height / model.image_size  # the unit of shifts
        rgba = _upright(rgba, roll, (shift[0] * focal, shift[1] * focal))
    if fitted:
        small = camera.resized(max(1, round(_RENDER_HEIGHT * width / height)), _RENDER_HEIGHT)
        opacity = run_to_end(render_steps(fitted, small, _RENDER_HEIGHT)).opacity.cpu().numpy()
        rgba[..., 3] = np.maximum(rgba[..., 3], _DOUBTFUL_OPACITY * _doubtful(rgba, opacity))
    view = PhotoView.of(*_around_object(rgba, camera.resized(width, height)))
    return replace(view, outline_margin=_outline_margin(photo, camera))


def _outline_margin(photo: Photo, camera: Camera) -> float | None:
    """Return :attr:`PhotoView.outline_margin`; None for a doubtful mask."""
    if photo.mask_confidence < DOUBTFUL_MASK:
        return None
    return (_MARGIN * camera.height + photo.edge_error) / camera.focal


def _doubtful(
    rgba: UInt8[np.ndarray, "height width 4"], opacity: Float[np.ndarray, "h w"]
) -> Bool[np.ndarray, "height width"]:
    """Mark background in which the fitted object is solid far from the mask: an occluder may hide it there.

    Args:
        opacity: of the fitted object as the photo's camera sees it.
    """
    import cv2  # loaded only if there is a photo
    from scipy.ndimage import distance_transform_edt

    height, width = rgba.shape[:2]
    rows, columns = opacity.shape
    background = cv2.resize(rgba[..., 3], (columns, rows), interpolation=cv2.INTER_AREA) < 128
    deep = (opacity > _SOLID) & (distance_transform_edt(background) > _DEEP_BACKGROUND * rows)
    if not deep.any():
        return np.zeros((height, width), bool)
    doubtful = (opacity > _SOLID) & (distance_transform_edt(~deep) < 2 * _DEEP_BACKGROUND * rows)  # up to the mask
    return cv2.resize(doubtful.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0


def photo_pixels(photo: Photo) -> UInt8[np.ndarray, "height width 4"]:
    """Return the photo's pixels on white with opacity, at full resolution if it has that."""
    if photo.fine is not None:
        return decompressed(photo.fine)
    opacity = photo.mask.float() if photo.opacity is None else photo.opacity
    return to_bytes(torch.cat((photo.pixels, opacity[..., None]), -1))


def _around_object(
    rgba: UInt8[np.ndarray, "height width 4"], camera: Camera
) -> tuple[UInt8[np.ndarray, "rows columns 4"], Camera]:
    """Crop an image to the object, keeping its middle; return it with the camera of the crop."""
    height, width = rgba.shape[:2]
    opaque = rgba[..., 3] > 0
    if not opaque.any():
        return rgba, camera
    left, top, right, bottom = bounding_box(opaque)
    reach = 1.04 * max(width / 2 - left, right - width / 2, height / 2 - top, bottom - height / 2)
    x, y = (max(0, math.floor(size / 2 - reach)) for size in (width, height))
    return rgba[y : height - y, x : width - x], replace(camera, width=width - 2 * x, height=height - 2 * y)


def _upright(
    rgba: UInt8[np.ndarray, "height width 4"], roll: float, shift: tuple[float, float]
) -> UInt8[np.ndarray, "height width 4"]:
    """Undo a roll (rad, clockwise) and a shift (px right, px down); pixels from outside become transparent white."""
    import cv2  # loaded only if there is a photo

    height, width = rgba.shape[:2]
    cos = math.cos(roll)
    sin = math.sin(roll)
    back = np.array([[cos, -sin], [sin, cos]])  # from the upright image to the photo
    middle = np.array([width, height]) / 2 - 0.5  # of pixels whose first is at 0
    matrix = np.column_stack((back, middle + shift - back @ middle))
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(rgba, matrix, (width, height), None, flags, cv2.BORDER_CONSTANT, (255, 255, 255, 0))
