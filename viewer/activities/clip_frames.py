"""Frames of a video as the photos of a fit."""

from collections.abc import Callable, Generator
from dataclasses import replace
from typing import NamedTuple

from PIL import Image

from core.models.photo_detail import MAX_PHOTOS
from core.photos.clip import is_clip
from viewer.activities.fit_stream import Confirmed
from viewer.services.backend import Backend
from viewer.values.cut_out_preview import CutOutPreview
from viewer.values.fit_history import FitRequest, PhotoSource

KeepImage = Callable[[PhotoSource, Image.Image], PhotoSource]  # returns a photo whose copy is the image


class ClipRequest(NamedTuple):
    """A request with frames in place of a video."""

    request: FitRequest
    confirmed: Confirmed  # cut-outs of the frames
    note: str  # frames that were left out; empty for none


def is_of_clip(request: FitRequest, confirmed: Confirmed) -> bool:
    """True for a request of a video whose frames have not been read, or are gone."""
    unread = request.history.sources[len(request.history.photos) :]
    return any(is_clip(source.file) and source not in confirmed for source in unread)


def read_frames(
    backend: Backend, request: FitRequest, keep_image: KeepImage
) -> Generator[float | ClipRequest, None, ClipRequest]:
    """Yield the read fraction of a request's video, 0..1, and at last a request of its frames, also the result."""
    source = request.history.sources[0]._replace(copy=None)
    cuts = yield from backend.clip(source.path)
    count = min(MAX_PHOTOS, len(cuts.frames))
    middles = [(2 * number + 1) * len(cuts.frames) // (2 * count) for number in range(count)]  # evenly spread
    frames = [cuts.frames[number] for number in middles]
    sources = tuple(keep_image(source, frame.image) for frame in frames)
    pairs = [(frame.cut, CutOutPreview.of(frame.image, frame.cut)) for frame in frames]
    confirmed = {frame_source: lambda pair=pair: pair for frame_source, pair in zip(sources, pairs, strict=True)}
    history = replace(request.history, sources=sources, photos=())
    clip = ClipRequest(request._replace(history=history, answered=len(sources)), confirmed, cuts.note)
    yield clip
    return clip
