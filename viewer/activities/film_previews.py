"""Small moving previews of the films that the object can have."""

from collections.abc import Hashable, Iterator
from dataclasses import replace

import numpy as np

from core.detail.progressive import Frame, RenderJob, RenderSettings
from core.export.films import SWING, TURN
from viewer.editor import Editor
from viewer.services.jobs import FIT_WEIGHT, Jobs
from viewer.services.latest import Latest
from viewer.values.share_settings import RATE, WIDE, ShareSettings, films_of

_WIDTH = 80  # px
_FRAMES = 16  # of a film, evenly spaced
_SAMPLES = 64  # intervals along the longest side of the scene's box
_Films = dict[str, tuple[Frame, ...]]  # the frames of each kind of film that are rendered so far, in order


class FilmPreviews:
    """Renders a few small frames of every film, and measures how much of them photos show."""

    def __init__(self, jobs: Jobs, editor: Editor) -> None:
        self._jobs = jobs
        self._editor = editor
        problem = "Cannot render the previews of films"
        self._rendered = Latest[tuple[Hashable, ...], _Films](jobs, "film previews", problem, weight=FIT_WEIGHT)

    def update(self, settings: ShareSettings) -> None:
        """Update the previews; call once a frame while they are visible."""
        scene = self._editor.scene
        partner = self._editor.film_partner
        height = round(_WIDTH / WIDE) if settings.wide else _WIDTH
        films = [replace(settings, kind=kind, size=height) for kind in films_of(scene, partner)]

        def stream() -> Iterator[_Films | None]:
            rendered = _Films()
            for film in films:
                views = film.views(scene, partner)
                yield None
                for index in range(_FRAMES):
                    view = views[index * len(views) // _FRAMES]
                    for frame in self._jobs.backend.frames(RenderJob(*view, RenderSettings(_SAMPLES, divisors=(1,)))):
                        if frame:
                            rendered = rendered | {film.kind: (*rendered.get(film.kind, ()), frame)}
                        yield rendered if frame else None

        self._rendered.of((scene, partner, settings.wide), stream, asks=not self._editor.history.gesture)

    def _frames(self, kind: str) -> tuple[Frame, ...]:
        return (self._rendered.current or {}).get(kind, ())

    def frame(self, kind: str, seconds: float) -> Frame | None:
        """Return a film's frame at a time, in a loop; the first frame until all are rendered, None before that."""
        frames = self._frames(kind)
        if len(frames) < _FRAMES:
            return next(iter(frames), None)
        length = (SWING if kind == "swing" else TURN) / RATE
        return frames[int(seconds / length * _FRAMES) % _FRAMES]

    def photo_shares(self, kind: str) -> tuple[float, float] | None:
        """Return the mean fractions of colours from the photo and from its mirror image; None until they are known."""
        frames = self._frames(kind)
        if len(frames) < _FRAMES or self._editor.scene.instance.detail is None:
            return None
        photo, mirrored = np.mean([frame.photo_shares for frame in frames], 0)
        return float(photo), float(mirrored)

    @property
    def moving(self) -> bool:
        """True while the previews are visible and one of them is complete."""
        return any(len(frames) == _FRAMES for frames in (self._rendered.current or {}).values())

    def close(self) -> None:
        """Stop rendering."""
        self._rendered.close()
