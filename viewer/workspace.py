"""One open model: its editor, and all activities around it. Another model has another workspace."""

import torch

from core.models.model import Model
from viewer.activities.exporting import Exporting
from viewer.activities.fitting import FitOptions, Fitting
from viewer.activities.grid import Grid
from viewer.activities.player import Player
from viewer.activities.segmenting import Segmenting
from viewer.activities.thumbnails import Thumbnails
from viewer.activities.viewport import Viewport, ViewSettings
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.worker import Job
from viewer.values import orbit

_VIEW_BANK_SHARE = 0.2
"""of the worker's time, for what the first fit will need"""


class Workspace:
    """Composition only: makes the parts and connects them."""

    def __init__(
        self, model: Model, jobs: Jobs, generator: torch.Generator, view: ViewSettings, fit: FitOptions
    ) -> None:
        self.model, self._jobs = model, jobs
        self.editor = Editor(model, generator)
        self.viewport = Viewport(jobs, self.editor, view)
        self.thumbnails = Thumbnails(jobs, model)
        self.grid = Grid(jobs)
        self.player = Player(jobs, self.editor, self.viewport)
        self.fitting = Fitting(jobs, self.editor, self.viewport, fit)
        self.segmenting = Segmenting(jobs, model, self.fitting.fit)
        self.fitting.no_background = self.segmenting.open
        self.exporting = Exporting(jobs, self.editor, self.grid)

    def start(self) -> None:
        """Render the first image, and prepare what a fit will need."""
        self.viewport.render()
        view_bank = self._jobs.backend.view_bank
        self._jobs.submit(Job("view bank", lambda: view_bank(self.model), lambda _: None, share=_VIEW_BANK_SHARE))

    def tick(self) -> None:
        """Once a frame: what advances with time."""
        self.player.tick()
        self.thumbnails.tick()

    def close(self) -> None:
        """End what is under way."""
        for part in (self.viewport, self.thumbnails, self.player, self.fitting, self.segmenting):
            part.close()
        self.exporting.cancel()
        self._jobs.cancel("view bank")

    def see_from(self, view: str) -> None:
        """One of :data:`viewer.values.orbit.VIEWS`, the first view (home), or the last photo's camera, if any."""
        if view == "home":
            self.viewport.reset_view()
        elif view == "photo" and self.fitting.history.last:
            self.editor.set_camera(self.fitting.camera)
        elif view in orbit.VIEWS:
            self.editor.set_camera(orbit.seen_from(self.editor.scene.camera, view))

    @property
    def orthographic(self) -> bool:
        """The view has no perspective."""
        return orbit.is_orthographic(self.editor.scene.camera, self.model)

    def set_orthographic(self, orthographic: bool) -> None:
        """See the object without perspective, or with the model's own."""
        self.editor.set_camera(orbit.with_perspective(self.editor.scene.camera, self.model, not orthographic))

    def segment_photo(self) -> None:
        """Point out the object in the photo of the fit that is shown."""
        self.segmenting.open(self.fitting.history.sources, self.fitting.history.photo_index)
