"""A run of the program: the model that is open, and what stays when another is opened. No window here."""

from collections.abc import Callable
from pathlib import Path

import torch

from core.models.model import Model
from core.models.scene import open_scene
from viewer.activities.fitting import FitOptions
from viewer.activities.viewport import ViewSettings
from viewer.services.backend import Backend
from viewer.services.jobs import Jobs
from viewer.services.messages import Messages
from viewer.services.worker import Job, Worker
from viewer.values.objects import EditableObject
from viewer.values.saved_session import SavedSession
from viewer.workspace import Workspace


class Session:
    """Composition only: opens models, gives each a workspace, and defers what has to wait for one."""

    def __init__(self, worker: Worker, backend: Backend | None = None, seed: int | None = None) -> None:
        self.messages = Messages()
        self.jobs = Jobs(worker, backend or Backend(), self.messages.notify, self.messages.report)
        self.view, self.fit_options = ViewSettings(), FitOptions()
        self.workspace: Workspace | None = None
        """None until the first model is open"""
        self.model_name = ""
        """of the model that is open"""
        self.loading = ""
        """the name of the model on its way"""
        self._deferred: list[Callable[[], None]] = []
        """what waits for the model on its way"""
        self._left: dict[str, SavedSession] = {}
        """by the name of their model, sessions that were left for another model"""
        self._generator = torch.Generator()
        self._generator.manual_seed(seed) if seed is not None else self._generator.seed()

    @property
    def fitting_runs(self) -> bool:
        """A fit is under way."""
        return self.workspace is not None and self.workspace.fitting.running

    def tick(self) -> None:
        """Once a frame: what came from the worker, and what advances with time."""
        self.jobs.worker.deliver()
        if self.workspace:
            self.workspace.tick()

    def open_model(self, name: str) -> None:
        """Load a model, by shipped name or path. The open one stays until it is there; what was made with the model
        comes back with it.
        """
        self.loading = name

        def ended(error: Exception | None) -> None:
            if error:
                self.loading = ""
                self._deferred.clear()
                self.messages.report(f"Cannot open the model {name}", error)

        load = self.jobs.backend.load_model
        self.jobs.submit(Job("model", lambda: (load(name),), lambda model: self._opened(name, model), ended))

    def when_ready(self, action: Callable[[], None]) -> None:
        """Do something now, or once the model on its way is open."""
        if self.workspace is not None and not self.loading:
            action()
        else:
            self._deferred.append(action)

    def fit_photos(self, *paths: Path) -> None:
        """Fit the object in images; see :meth:`viewer.activities.fitting.Fitting.start`."""
        self.when_ready(lambda: self._workspace().fitting.start(*paths))

    def open_scene(self, path: Path) -> None:
        """Open a scene, or an image that holds one: its object joins the objects. What cannot be read, or is of
        another model, changes nothing.
        """
        self.when_ready(lambda: self._open_scene(path))

    def save(self) -> SavedSession | None:
        """What was made with the open model, as text; None if nothing was."""
        if self.workspace is None or not self.workspace.editor.history.past:
            return None
        editor = self.workspace.editor
        return SavedSession.of(self.model_name, editor.state, editor.objects.added)

    def restore(self, saved: SavedSession, done: Callable[[], None] = lambda: None) -> None:
        """Continue a saved session, its model first; what cannot be read changes nothing.

        Args:
            done: called once all of it is back.
        """
        if self.workspace is not None and not self.loading and self.model_name == saved.model:
            self._restore(saved, done)
            return
        if (self.loading or self.model_name) != saved.model:
            self.open_model(saved.model)
        self.when_ready(lambda: self.restore(saved, done))

    def _workspace(self) -> Workspace:
        assert self.workspace is not None, "no model yet"
        return self.workspace

    def _opened(self, name: str, model: Model) -> None:
        if self.workspace:
            if left := self.save():
                self._left[self.model_name] = left
            self.workspace.close()
        self.model_name, self.loading = name, ""
        self.workspace = Workspace(model, self.jobs, self._generator, self.view, self.fit_options)
        self.workspace.start()
        if left := self._left.pop(name, None):
            self._restore(left)
        deferred, self._deferred = self._deferred, []
        for action in deferred:
            action()

    def _open_scene(self, path: Path) -> None:
        workspace = self._workspace()
        try:
            scene = open_scene(path, workspace.model)
        except ValueError as error:
            self.messages.report("Cannot open the scene", error)
        else:
            workspace.editor.add_and_show(EditableObject(path.stem, scene.codes), scene.camera)
            self.messages.notify(f"Opened {path.name}")

    def _restore(self, saved: SavedSession, done: Callable[[], None] = lambda: None) -> None:
        try:
            self._workspace().editor.restore(saved)
        except ValueError as error:
            self.messages.report("Cannot restore the session", error)
        else:
            self.messages.notify("Restored the session")
            done()
