"""Small moving previews of the films that the object can have."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from core.detail.progressive import Frame, RenderJob, RenderSettings
from viewer.editor import Editor
from viewer.services.jobs import FIT_WEIGHT, Jobs
from viewer.services.worker import Job
from viewer.values.share_settings import RATE, WIDE, ShareSettings, films_of

_WIDTH = 80  # px
_FRAMES = 16  # of a film, evenly spaced
_SAMPLES = 64  # intervals along the longest side of the scene's box
_NAME = "film previews"  # job


class FilmPreviews:
    """Renders a few small frames of every film, and measures how much of them photos show."""

    def __init__(self, jobs: Jobs, editor: Editor) -> None:
        self._jobs = jobs
        self._editor = editor
        self._frames: dict[str, list[Frame]] = {}  # by kind of film, in order
        self._lengths: dict[str, float] = {}  # s, by kind of film
        self._inputs: tuple[object, ...] = ()  # of the frames

    def update(self, settings: ShareSettings) -> None:
        """Update the previews; call once a frame while they are visible."""
        scene = self._editor.scene
        partner = self._editor.film_partner
        inputs = scene, partner, settings.wide
        if inputs == self._inputs or self._editor.history.gesture:
            return
        self._inputs = inputs
        self._frames.clear()
        height = round(_WIDTH / WIDE) if settings.wide else _WIDTH
        films = [replace(settings, kind=kind, size=height) for kind in films_of(scene, partner)]

        def stream() -> Iterator[tuple[str, Frame, float] | None]:
            for film in films:
                views = film.views(scene, partner)
                yield None
                for index in range(_FRAMES):
                    view = views[index * len(views) // _FRAMES]
                    for frame in self._jobs.frames(RenderJob(*view, RenderSettings(_SAMPLES, divisors=(1,)))):
                        yield (film.kind, frame, len(views) / RATE) if frame else None

        ended = self._jobs.reporting("Cannot render the previews of films")
        self._jobs.submit(Job(_NAME, stream, self._keep, ended, weight=FIT_WEIGHT))

    def _keep(self, rendered: tuple[str, Frame, float]) -> None:
        kind, frame, length = rendered
        self._frames.setdefault(kind, []).append(frame)
        self._lengths[kind] = length

    def frame(self, kind: str, seconds: float) -> Frame | None:
        """Return a film's frame at a time, in a loop; the first frame until all are rendered, None before that."""
        frames = self._frames.get(kind)
        if not frames:
            return None
        return frames[int(seconds / self._lengths[kind] * _FRAMES) % _FRAMES] if len(frames) == _FRAMES else frames[0]

    def photo_shares(self, kind: str) -> tuple[float, float] | None:
        """Return the mean fractions of colours from the photo and from its mirror image; None until they are known."""
        frames = self._frames.get(kind, [])
        if len(frames) < _FRAMES or self._editor.scene.instance.detail is None:
            return None
        photo, mirrored = np.mean([frame.photo_shares for frame in frames], 0)
        return float(photo), float(mirrored)

    @property
    def moving(self) -> bool:
        """True while the previews are visible and one of them is complete."""
        return bool(self._inputs) and any(len(frames) == _FRAMES for frames in self._frames.values())

    def close(self) -> None:
        """Stop rendering."""
        self._jobs.cancel(_NAME)
        self._frames.clear()
        self._inputs = ()
