"""A run of the program: the model that is open, and what stays when another is opened. No window here."""

from collections.abc import Callable, Iterator
from pathlib import Path

import torch

from core.models.library import shipped_models
from core.models.model import Model
from core.models.scene import open_scene, scene_model
from viewer.activities.fit_stream import FitOptions
from viewer.services.backend import Backend
from viewer.services.jobs import Jobs
from viewer.services.kept_thumbnails import KeptThumbnails
from viewer.services.messages import Button, MessageKind, Messages
from viewer.services.photo_thumbnails import PhotoThumbnails
from viewer.services.signal import Signal
from viewer.services.user_objects import UserObjects
from viewer.services.worker import Job, Worker
from viewer.values.fit_history import PhotoSource, Waiting
from viewer.values.objects import EditableObject
from viewer.values.printable import printable
from viewer.values.project import Project
from viewer.values.saved_session import SavedSession
from viewer.values.view_request import ViewSettings
from viewer.workspace import Workspace


class Session:
    """Composition only: opens models, gives each a workspace, and defers what has to wait for one."""

    def __init__(self, worker: Worker, backend: Backend | None = None, seed: int | None = None) -> None:
        self.messages = Messages()
        self.jobs = Jobs(worker, backend or Backend(), self.messages)
        self.photo_thumbnails = PhotoThumbnails(self.jobs)
        self.view, self.fit_options = ViewSettings(), FitOptions()
        self.workspace: Workspace | None = None
        """None until the first model is open"""
        self.model_name = ""
        """of the model that is open"""
        self.loading = ""
        """the name of the model on its way"""
        self.user_objects = UserObjects()
        """the objects that last from launch to launch"""
        self.kept_thumbnails = KeptThumbnails()
        """of a model's objects, which last too"""
        self.archive = Signal[Project]()
        """emitted with what is about to be replaced, or cannot be continued with"""
        self._deferred: list[Callable[[], None]] = []
        """what waits for the model on its way"""
        self._elsewhere: tuple[Waiting, ...] = ()
        """photos of another category, which wait until the model can be changed"""
        self._left: tuple[SavedSession, ...] = ()
        """sessions that go on when their model is opened next"""
        self.project_path: Path | None = None
        """where the project was saved, or opened from"""
        self._replacing: tuple[Project, Callable[[], None]] | None = None
        """what takes the place of everything once its model is there, and what to do then"""
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
            if self._elsewhere and self._is_idle(self.workspace):
                self._fit_with_other_model()

    def open_model(self, name: str) -> None:
        """Load a model, by shipped name or path. The open one stays until it is there; what was made with the model
        comes back with it. A project that is on its way comes first.
        """
        if self._replacing and name != self._replacing[0].model:
            self.when_ready(lambda: self.open_model(name))
            return
        self.loading = name

        def ended(error: Exception | None) -> None:
            if error:
                self.loading, self._replacing = "", None
                self._deferred.clear()
                self.messages.report(f"Cannot open the model {name}", error)

        load = self.jobs.backend.load_model
        self.jobs.submit(Job("model", lambda: (load(name),), lambda model: self._opened(name, model), ended))

    def change_model(self, name: str) -> None:
        """Open another model, at once unless something is under way that this would end: a person decides then."""
        if name == self.model_name:
            return
        if self._is_idle(self._workspace()):
            self.open_model(name)
            return
        offer = Button("Open it", lambda: self.open_model(name))
        text = f"Open {Path(name).name}? What is under way would end"
        self.messages.notify(text, MessageKind.NOTE, buttons=(offer,))

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
        """Open a scene, or an image that holds one: its object joins the objects. One of another shipped model opens
        that first; what cannot be read, or is of no such model, changes nothing.
        """
        self.when_ready(lambda: self._open_scene(path))

    # What was made

    def project(self) -> Project:
        """All that was made, with every model."""
        saved = self.workspace.saved(self.model_name) if self.workspace else None
        return Project(self.model_name, (*self._left, *((saved,) if saved else ())), self.project_path)

    @property
    def parts(self) -> tuple[object, ...]:
        """Everything :meth:`project` is made of: as long as these are the same, so is that."""
        return (self.project_path, *self._left, *(self.workspace.parts if self.workspace else ()))

    def adopt(self, project: Project) -> None:
        """Resume the saved session of each model when it is next opened."""
        self.project_path, self._left = project.path, project.sessions

    def add(self, project: Project) -> None:
        """Put a project beside all that was made: its states before those of now, its objects among the others; its
        model is opened where nothing was made with this one. Raises ``ValueError`` where this model cannot go on with
        it, and changes nothing then.
        """
        for saved in project.sessions:
            if saved.model == self.model_name:
                saved.check(self._workspace().model)
        fresh = self._workspace().saved(self.model_name) is None
        self._left = (*self._left, *project.sessions)
        for saved in self._take(self.model_name):
            self._restore(saved)
        if fresh and project.model != self.model_name:
            self.open_model(project.model)

    def _take(self, model: str) -> tuple[SavedSession, ...]:
        """Of what waits for its model, the sessions of this one, which wait no more."""
        taken = tuple(saved for saved in self._left if saved.model == model)
        self._left = tuple(saved for saved in self._left if saved.model != model)
        return taken

    def save_project(self, path: Path) -> bool:
        """Write all that was made into one file, which names no folder of this machine; whether that could be done."""
        try:
            self.project().shared().save(path)
        except Exception as error:
            self.messages.report("Cannot save the project", error)
            return False
        self.project_path = path
        self.messages.notify(f"Saved {path.name}")
        return True

    def open_project(self, path: Path, keep_path: bool = True) -> None:
        """Put a project in the place of all that was made. What cannot be read changes nothing.

        Args:
            keep_path: it is saved there again.
        """

        def opened() -> None:
            self.project_path = path if keep_path else None
            self.messages.notify(f"Opened {path.name}")

        try:
            project = Project.load(path).beside(path.parent)
        except ValueError as error:
            self.messages.report("Cannot open the project", error)
        else:
            self.replace(project, opened)

    def replace(self, project: Project, done: Callable[[], None] = lambda: None) -> None:
        """Put another project in the place of all that was made; its model is opened first.

        Args:
            done: called once it is there.
        """
        self._replacing = project, done
        if self.workspace is not None and not self.loading and self.model_name == project.model:
            self._opened(self.model_name, self.workspace.model)
        else:
            self.open_model(project.model)

    def new(self) -> None:
        """Begin afresh with the open model; fitted objects stay."""
        self.when_ready(lambda: self.replace(Project(self.model_name, ())))

    def _workspace(self) -> Workspace:
        assert self.workspace is not None, "no model yet"
        return self.workspace

    def _opened(self, name: str, model: Model) -> None:
        replacing, self._replacing, self.loading = self._replacing, None, ""
        try:
            if not replacing:
                if self.workspace and (left := self.workspace.saved(self.model_name)):
                    self._left = (*self._left, left)
                self._begin(name, model)
            elif self._archive_current(replacing[0], model):
                self._begin(name, model)
                replacing[1]()
        except Exception as error:  # of a model that stands in no window
            self.messages.report(f"Cannot open the model {name}", error)
        deferred, self._deferred = self._deferred, []
        for action in deferred:
            action()

    def _begin(self, name: str, model: Model) -> None:
        """Give a model a workspace, once that stands in place of the old one, and go on with what was made with it."""
        if self.workspace:
            self.view = self.workspace.viewport.settings
        kept = self.user_objects, self.kept_thumbnails
        begun = Workspace(model, self.jobs, self._generator, self.view, self.fit_options, *kept)
        if self.workspace:
            self.workspace.close()
        self.model_name, self.workspace = name, begun
        self.workspace.fitting.other_category.connect(self._fit_with_its_model)
        self.workspace.start()
        for left in self._take(name):
            self._restore(left)

    def _archive_current(self, project: Project, model: Model) -> bool:
        """Keep aside what a project replaces; not if its session cannot be continued with."""
        for saved in project.sessions:
            if saved.model == project.model:
                try:
                    saved.check(model)
                except ValueError as error:
                    self.messages.report("Cannot open the project", error)
                    return False
        if (before := self.project()).sessions:
            self.archive.emit(before)
        self.adopt(project)
        return True

    def _open_scene(self, path: Path) -> None:
        workspace = self._workspace()
        try:
            scene = open_scene(path, workspace.model)
        except ValueError as error:
            self._open_with_another_model(path, error)
        else:
            workspace.editor.add_and_show(EditableObject(printable(path.stem), scene.codes), scene.camera)
            self.messages.notify(f"Opened {path.name}")

    def _open_with_another_model(self, path: Path, error: ValueError) -> None:
        """Look for the shipped model that a scene belongs to."""
        wanted, load, here = scene_model(path), self.jobs.backend.load_model, self.model_name
        if not wanted or self._workspace().model.shares_codes_with(wanted):
            self.messages.report("Cannot open the scene", error)
            return

        def search() -> Iterator[str]:
            for name in shipped_models():
                if name != here and load(name).shares_codes_with(wanted):
                    yield name
                    return
            raise error

        def found(name: str) -> None:
            self.open_model(name)
            self.open_scene(path)

        self.jobs.submit(Job(f"model of {path}", search, found, self.jobs.reporting("Cannot open the scene")))

    def _fit_with_its_model(self, sources: tuple[PhotoSource, ...], category: str) -> None:
        """Photos of another category are fitted with the model of that, once nothing here would be lost by it."""
        here, exporting = self._workspace().model.category, self._workspace().exporting
        waits = Waiting(sources, category)
        text = f"{waits.name} looks like {category}, not {here}: that model opens for it"
        buttons: tuple[Button, ...] = (Button(f"Rebuild as {here} anyway", lambda: self._insist(waits, here)),)
        if exporting.path:
            text += f" once {exporting.path.name} is saved"
            buttons = (Button("Do it now", lambda: self.do_now(waits)), *buttons)
        self._elsewhere = (*self._elsewhere, waits)
        self.messages.notify(text, MessageKind.NOTE, buttons=buttons, holds=lambda: waits in self._elsewhere)

    def _insist(self, waits: Waiting, category: str) -> None:
        """A person knows better than the classifier."""
        known = tuple(source._replace(category=category) for source in waits.sources)
        self._elsewhere = _without(self._elsewhere, waits)
        if self._workspace().model.category == category:
            self._workspace().fitting.fit(*known)
        else:
            self._elsewhere = (*self._elsewhere, Waiting(known, category))

    def _is_idle(self, workspace: Workspace) -> bool:
        """Nothing is under way that another model would end."""
        busy = workspace.fitting.running, workspace.segmenting.active, workspace.exporting.running
        return not (self.loading or self._replacing or any(busy))

    def _fit_with_other_model(self) -> None:
        category = self._elsewhere[0].category
        photos = [waits.sources for waits in self._elsewhere if waits.category == category]
        self._elsewhere = tuple(waits for waits in self._elsewhere if waits.category != category)

        def begin() -> None:
            for sources in photos:
                self._workspace().fitting.fit(*sources)

        self.open_model(category)
        self.when_ready(begin)

    @property
    def waiting(self) -> tuple[Waiting, ...]:
        """Photos that are not fitted yet: those of the open model, then those of others, in their order."""
        queue = self.workspace.fitting.queue if self.workspace else ()
        return (*(Waiting(request.history.sources) for request in queue), *self._elsewhere)

    def do_now(self, waits: Waiting) -> None:
        """Fit photos before all others. A fit under way waits then; a file under way is given up where the model of
        another category has to open.
        """
        if not waits.category:
            self._workspace().fitting.begin_now(waits.sources)
        elif waits in self._elsewhere:
            self._elsewhere = (waits, *_without(self._elsewhere, waits))
            self._workspace().exporting.cancel()
            self._fit_with_other_model()

    def forget(self, waits: Waiting) -> None:
        """Do not fit photos that wait."""
        self._elsewhere = _without(self._elsewhere, waits)
        self._workspace().fitting.forget(waits.sources)

    def _restore(self, saved: SavedSession) -> None:
        try:
            self._workspace().restore(saved)
        except ValueError as error:
            self.archive.emit(Project(saved.model, (saved,)))
            self.messages.report(f"Cannot go on with what was made with {saved.model}", error)


def _without(all_of_them: tuple[Waiting, ...], one: Waiting) -> tuple[Waiting, ...]:
    return tuple(other for other in all_of_them if other is not one)
