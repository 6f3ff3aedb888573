"""One open model: its editor, and all activities around it. Another model has another workspace."""

import torch

from core.models.model import Model
from core.photos.direction_words import Words
from viewer.activities.exporting import Exporting
from viewer.activities.fit_stream import FitOptions
from viewer.activities.fitting import Fitting
from viewer.activities.grid import Grid
from viewer.activities.idle_turn import IdleTurn
from viewer.activities.player import Player
from viewer.activities.segmenting import Segmenting
from viewer.activities.thumbnails import Thumbnails
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import BACKGROUND_SHARE, Jobs
from viewer.services.kept_thumbnails import KeptThumbnails
from viewer.services.user_objects import UserObjects
from viewer.services.worker import Job
from viewer.values import orbit
from viewer.values.fit_history import FitHistory, FitRequest, PhotoSource
from viewer.values.part import Part
from viewer.values.saved_session import SavedSession
from viewer.values.view_request import ViewSettings


class Workspace:
    """Composition only: makes the parts and connects them."""

    def __init__(
        self,
        model: Model,
        jobs: Jobs,
        generator: torch.Generator,
        view: ViewSettings,
        fit: FitOptions,
        user_objects: UserObjects,
        kept_thumbnails: KeptThumbnails,
    ) -> None:
        self.model, self._jobs, self._user_objects = model, jobs, user_objects
        self._directions = user_objects.directions(model)
        """those that are kept"""
        self.editor = Editor(model, generator, self._directions)
        self._initially_there = frozenset(map(self.editor.objects.add, user_objects.open(model)))
        """names of objects that were there from the beginning"""
        self._kept = self.editor.objects.version
        self._prepared = 0.0
        self._words: Words = {}
        """of the principal directions, once they are measured"""
        self._awaiting_box: tuple[tuple[tuple[PhotoSource, ...], int], ...] = ()
        """photos whose object is to be pointed out after the one that is"""
        self._prompting: tuple[PhotoSource, ...] = ()
        """whose object is being pointed out, as it was not found"""
        self.viewport = Viewport(jobs, self.editor, view)
        self.thumbnails = Thumbnails(jobs, model, kept_thumbnails)
        self.idle_turn = IdleTurn(jobs, self.editor, self.viewport)
        self.grid = Grid(jobs)
        self.player = Player(jobs, self.editor, self.viewport)
        self.fitting = Fitting(jobs, self.editor, self.viewport, fit)
        self.segmenting = Segmenting(jobs, model, self.fitting.fit)
        self.fitting.no_background.connect(self._ask_for_box)
        self.exporting = Exporting(jobs, self.editor, self.grid)

    def start(self) -> None:
        """Render the first image, and make what fits wait for."""
        self.viewport.render()
        view_bank, words = self._jobs.backend.view_bank, self._jobs.backend.direction_words
        self._jobs.submit(Job("words", lambda: words(self.model), self._name_directions, share=BACKGROUND_SHARE))
        self._jobs.submit(Job("view bank", lambda: view_bank(self.model), self._prepare, share=BACKGROUND_SHARE))

    def word(self, part: Part, index: int) -> str:
        """What more of a principal direction makes of the object, such as *wider*; empty where that is not known."""
        words = self._words.get(part, ())
        return words[index] if index < len(words) else ""

    def _name_directions(self, words: Words) -> None:
        self._words = words

    def _prepare(self, share: float) -> None:
        self._prepared = share

    @property
    def preparing(self) -> float | None:
        """Which share (0..1) of the view bank is made; None once it is there."""
        return self._prepared if self._prepared < 1 and self._jobs.busy("view bank") else None

    def tick(self) -> None:
        """Once a frame: what advances with time."""
        self.viewport.tick()
        self.player.tick()
        self.thumbnails.tick()
        self.fitting.tick()
        if self._awaiting_box and not self.segmenting.active:
            first, *others = self._awaiting_box
            self._awaiting_box, self._prompting = tuple(others), first[0]
            self.segmenting.open(*first)
        if self._kept != self.editor.objects.version or self._directions is not self.editor.state.directions:
            self._keep_user_objects()

    def close(self) -> None:
        """End what is under way."""
        for part in (self.viewport, self.thumbnails, self.player, self.fitting, self.segmenting):
            part.close()
        self.exporting.cancel()
        self._jobs.cancel("view bank", "words")

    def saved(self, name: str) -> SavedSession | None:
        """All that was made, under the name of the model; None if nothing was."""
        history, objects, fitting = self.editor.history, self.editor.objects, self.fitting
        pending = (*fitting.pending, *(FitRequest(FitHistory(sources)) for sources in self._not_found))
        if not (history.past or history.future or fitting.history.sources or pending):
            return None
        used = frozenset(self.grid.names).union(*(state.mix.names for state in history.states))
        return SavedSession(
            name,
            history.without_gesture(),
            tuple(one for one in objects.ever_added if one.name in used or one.name not in self._initially_there),
            tuple(objects.removed),
            self.grid.names,
            FitHistory() if fitting.running and not fitting.results.checking else fitting.history,
            fitting.candidates.saved(),
            pending,
        )

    @property
    def parts(self) -> tuple[object, ...]:
        """Everything :meth:`saved` is made of: as long as these are the same, so is that."""
        objects, fitting = self.editor.objects, self.fitting
        fit = fitting.request, fitting.queue, fitting.results.checking, fitting.history.photos
        steps = None if fitting.running else fitting.history.steps
        added = objects.ever_added
        return (self.editor.history, objects.removed, self.grid.names, *fit, steps, *self._not_found, *added)

    def restore(self, saved: SavedSession) -> None:
        """Go on with a saved session. Raises ``ValueError`` where that cannot be, and changes nothing then."""
        self.editor.restore(saved)
        self.grid.add(*(name for name in saved.grid if name in self.editor.objects))
        if not self.fitting.history.sources:
            self.fitting.candidates.restore(saved.tiles)
        self.fitting.restore(saved.fit, saved.pending)

    def rename(self, name: str, to: str) -> None:
        """Give an added object another name, wherever it is mentioned."""
        new = self.editor.rename(name, to)
        self.grid.rename(name, new)
        self.fitting.rename(name, new)

    def remove(self, name: str) -> None:
        """Take an added object out of all lists; what is shown stays."""
        self.editor.objects.remove(name)
        self.grid.remove(name)
        self.fitting.results.unseen.pop(name, None)

    def see_from(self, view: str) -> None:
        """One of :data:`viewer.values.orbit.VIEWS`, the first view (home), or the last photo's camera, if any."""
        if view == "home":
            self.viewport.reset_view()
        elif view == "photo" and self.fitting.history.last:
            self.editor.set_camera(self.fitting.view.camera)
        elif view in orbit.VIEWS:
            self.editor.set_camera(orbit.seen_from(self.viewport.camera, view))

    @property
    def orthographic(self) -> bool:
        """The view has no perspective."""
        return orbit.is_orthographic(self.viewport.camera, self.model)

    def set_orthographic(self, orthographic: bool) -> None:
        """See the object without perspective, or with the model's own."""
        camera = self.viewport.camera
        self.editor.set_camera(orbit.with_perspective(camera, self.model, not orthographic))

    def segment_photo(self) -> None:
        """Point out the object in the photo of the fit that is shown."""
        self.segmenting.open(self.fitting.history.sources, self.fitting.history.photo_index)

    @property
    def _not_found(self) -> tuple[tuple[PhotoSource, ...], ...]:
        """Photos whose object is still to be pointed out."""
        asked = self.segmenting.active and self._prompting and self.segmenting.sources == self._prompting
        return (*((self._prompting,) if asked else ()), *(sources for sources, _ in self._awaiting_box))

    def _ask_for_box(self, sources: tuple[PhotoSource, ...], index: int) -> None:
        """In this photo the object was not found: a person is asked, for one photo at a time."""
        self._awaiting_box = (*self._awaiting_box, (sources, index))

    def _keep_user_objects(self) -> None:
        """Keep fitted objects and named directions for the next launch."""
        objects = self.editor.objects
        self._kept, self._directions = objects.version, self.editor.state.directions
        try:
            self._user_objects.sync(self.model, [one for one in objects.added if one.fitted])
            self._user_objects.keep_directions(self.model, self._directions)
        except (ValueError, OSError) as error:
            self._jobs.messages.report("Cannot keep what was made", error)
