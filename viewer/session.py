"""A run of the program apart from its window: the editor, its activities, and their saved state."""

from collections.abc import Callable
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8

from core.detail.progressive import Frame
from core.geometry.camera import Camera
from core.models.library import DEFAULT_MODEL, sample_images, shipped_models
from core.models.model import Model
from core.models.open_models import OpenModels
from core.models.photo_detail import PhotoView
from core.models.scene import open_scene, scene_model
from viewer.activities.direction_words import DirectionWords
from viewer.activities.exporting import Exporting
from viewer.activities.fit_stream import FitOptions
from viewer.activities.fitting import Fitting
from viewer.activities.kept_objects import KeptObjects
from viewer.activities.names import Names
from viewer.activities.painting import Painting
from viewer.activities.reshaping import Reshaping
from viewer.activities.segmenting import Segmenting
from viewer.activities.sizing import Sizing
from viewer.activities.thumbnails import Thumbnails
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.backend import Backend
from viewer.services.jobs import Jobs
from viewer.services.messages import Button, MessageKind, Messages
from viewer.services.photo_copies import PhotoCopies
from viewer.services.photo_thumbnails import PhotoThumbnails
from viewer.services.pictures import Pixels, read_pictures
from viewer.services.signal import Signal
from viewer.services.user_objects import UserObjects
from viewer.services.worker import Job, Worker
from viewer.values import orbit
from viewer.values.encoding import Original
from viewer.values.fit_history import FitHistory, FitRequest
from viewer.values.objects import EditableObject
from viewer.values.printable import printable
from viewer.values.project import Project
from viewer.values.view_request import ViewSettings

PICTURES = "pictures-3.safetensors"  # file of the last images of view and tiles; another name if renders change


class Session:
    """Creates and connects editor and activities; opens, saves and replaces projects."""

    def __init__(
        self,
        worker: Worker,
        backend: Backend | None = None,
        seed: int | None = None,
        folder: Path | None = None,
        first: str = DEFAULT_MODEL,
    ) -> None:
        """Open the shipped models and show the first object of one.

        Args:
            folder: folder of objects and pictures kept between launches; None keeps nothing.
            first: name of a shipped model, or path of another one.

        Raises ``ValueError`` if a model cannot be opened.
        """
        backend = backend or Backend()
        self.messages = Messages()
        self.models = OpenModels(backend.load_model)
        self.jobs = Jobs(worker, backend, self.messages, self.models)
        self.photo_thumbnails = PhotoThumbnails(self.jobs)
        self.fit_options = FitOptions()
        self.archive = Signal[Project]()  # emitted with a project that is about to be replaced
        self.project_path: Path | None = None  # file of the saved or opened project
        self._user_objects = UserObjects(folder and folder / "mine")
        self._photo_copies = PhotoCopies(folder and folder / "photos")
        self._pictures = read_pictures(folder / PICTURES) if folder else {}  # images of the last session
        self._generator = torch.Generator()
        self._generator.manual_seed(seed) if seed is not None else self._generator.seed()
        self.words = DirectionWords(self.jobs)
        for name in dict.fromkeys((*shipped_models(), first)):
            self.models.open(name)
        for fingerprint, file in self._user_objects.model_files().items():
            self.models.expect(fingerprint, file)
            self.models.find(fingerprint)
        self._begin(self.models.open(first), ViewSettings())

    def _begin(self, first: Model, view: ViewSettings) -> None:
        """Create editor and activities in their initial state, with the kept objects."""
        jobs = self.jobs
        self.editor = Editor(self.models, first, self._generator)
        self.kept_objects = KeptObjects(self._user_objects, self.models, self.editor.objects, self.messages)
        self._waiting = FitHistory(), tuple[FitRequest, ...]()  # the last fit and requests of models that are missing
        self.originals = tuple[Original, ...]()  # project files of which something could not be read
        self.viewport = Viewport(jobs, self.editor, view)
        self.thumbnails = Thumbnails(jobs, self._pictures)
        self.names = Names(self.editor, self.words)
        self.fitting = Fitting(jobs, self.editor, self.viewport, self.fit_options, self._photo_copies)
        self.segmenting = Segmenting(jobs, self.fitting.fit)
        self.sizing = Sizing(jobs, self.editor)
        self.reshaping = Reshaping(jobs, self.editor, self.viewport, self.sizing)
        self.painting = Painting(jobs, self.editor, self.viewport, self.reshaping)
        self.exporting = Exporting(jobs, self.editor, self.names)

    def start(self) -> None:
        """Begin to render the scene."""
        self.viewport.begin(self._pictures)

    def tick(self) -> None:
        """Deliver the worker's results and advance the activities; call once a frame."""
        self.jobs.worker.deliver()
        self._add_models()
        self.viewport.tick()
        self.thumbnails.tick()
        self.fitting.tick()
        self.painting.tick()
        self.kept_objects.tick()

    def close(self) -> None:
        """Cancel all jobs of the activities."""
        for activity in (self.viewport, self.thumbnails, self.fitting, self.segmenting, self.painting):
            activity.close()
        self.jobs.cancel("parts", "size")
        self.exporting.cancel()

    # Models and their objects

    def open_model(self, name: str, expected: str = "", show: Callable[[], None] | None = None) -> None:
        """Open a model by its shipped name or path in the background, then show its first object.

        Args:
            expected: fingerprint of the missing model that it should be; empty for any model.
            show: shows something else than the first object.
        """
        load = self.jobs.backend.load_model

        def loaded(model: Model) -> None:
            if expected and not model.shares_codes_with(expected):
                text = f"{Path(name).name} is another model than {self.model_name(expected)}: choose the one from then"
                self.messages.notify(text, MessageKind.PROBLEM)
                return
            self.models.add(name, model)
            self._add_models()
            show() if show else self.show_model(name)
            self.messages.notify(f"Opened {Path(name).name}")

        self.jobs.submit(
            Job(f"model {name}", lambda: (load(name),), loaded, self.jobs.reporting("Cannot open the model"))
        )

    def show_model(self, name: str) -> None:
        """Show a model's first object, unless one of its objects is shown; ``name`` may be a path."""
        model = self.models.open(name)
        self._add_models()
        if self.editor.model is not model:
            self.editor.show_object(next(iter(self.editor.objects.families[model.fingerprint])))

    def _add_models(self) -> None:
        """Add the objects of newly opened models to the library; what waited for a model goes on."""
        new = [model for model in self.models if model.fingerprint not in self.editor.objects.families]
        for model in new:
            self.editor.add_model(model)
        if new:
            self._restore_fits(*self._waiting)

    def _restore_fits(self, fit: FitHistory, pending: tuple[FitRequest, ...]) -> None:
        """Show the last fit and continue requests; those of missing models wait for them."""

        def is_there(history: FitHistory) -> bool:
            return not history.model or self.models.find(history.model) is not None

        waiting = tuple(request for request in pending if not is_there(request.history))
        self._waiting = FitHistory() if is_there(fit) else fit, waiting
        due = tuple(
            request._replace(history=request.history.converted(self.models.adopt))
            for request in pending
            if request not in waiting
        )
        self.fitting.restore(fit.converted(self.models.adopt) if is_there(fit) else FitHistory(), due)

    def rename(self, name: str, to: str) -> None:
        """Rename an added object everywhere."""
        new = self.editor.rename(name, to)
        self.fitting.rename(name, new)

    def remove(self, *names: str) -> None:
        """Remove added objects, versions of one, from all lists, even if on screen, and offer to undo that."""
        editor = self.editor
        editor.remove(*names)
        for name in names:
            self.fitting.results.unseen.pop(name, None)
        after = editor.history

        def undo() -> None:
            editor.undo() if editor.history is after else editor.put_back(*names)

        def relevant() -> bool:
            return self.editor is editor and editor.objects.removed.issuperset(names)

        label = self.names.label(names[0])
        self.messages.notify(f"Removed {label}", buttons=(Button("Undo", undo),), relevant=relevant, passing=True)

    def sweep_photos(self) -> None:
        """Delete old copies of photos that are fitted, and of the whole photos of objects that are gone."""
        pending = (*self.fitting.pending, *self._waiting[1])
        details = (added.instance.detail for added in self.editor.objects.ever_added)
        self._photo_copies.sweep(
            (source for request in pending for source in request.history.sources),
            (view for detail in details if detail for view in detail.views),
        )

    def keep_edits(self, project: Project) -> None:
        """Store the edits of a project's objects, on any thread. Raises ``ValueError`` or ``OSError`` on failure."""
        self._user_objects.update(self.models, project.objects)

    @property
    def pictures(self) -> dict[str, Pixels]:
        """The last images of view and tiles by name, for the next launch."""
        return self.thumbnails.newest | self.viewport.picture

    @property
    def picture_state(self) -> tuple[Frame | None, int]:
        """The view's image and the number of rendered tiles; while they are the same, so are :attr:`pictures`."""
        return self.viewport.frame, self.thumbnails.rendered

    @property
    def is_rendered(self) -> bool:
        """True while the view is sharp and no tile is rendered."""
        return self.viewport.sharp and not self.jobs.busy("view", "thumbnails")

    @property
    def samples(self) -> tuple[Path, ...]:
        """The paths of sample photos, alternating between categories."""
        paths = zip_longest(*map(sample_images, dict.fromkeys(model.category for model in self.models)))
        return tuple(path for several in paths for path in several if path)

    # The view

    def see_from(self, view: str) -> None:
        """Turn the view to one of :data:`viewer.values.orbit.VIEWS`, or to the photo's camera ("photo"), if any."""
        if view == "photo" and (camera := self.photo_camera):
            self.viewport.change(pan=(0.0, 0.0))
            self.editor.set_camera(camera)
        elif view in orbit.VIEWS:
            self.editor.set_camera(orbit.seen_from(self.viewport.camera, view))

    @property
    def photo_view(self) -> PhotoView | None:
        """The selected photo of the object on screen, if it has photo detail."""
        detail = self.editor.scene.instance.detail
        return detail.views[min(self.fitting.shown.photo_index, len(detail.views) - 1)] if detail else None

    @property
    def whole_photo(self) -> UInt8[np.ndarray, "height width 3"] | None:
        """The whole photo of :attr:`photo_view` with the outline of the cut-out, if a copy is there."""
        view = self.photo_view
        return self._photo_copies.photo_of(view) if view else None

    @property
    def photo_camera(self) -> Camera | None:
        """The camera of :attr:`photo_view`, at the size of the model's images."""
        view = self.photo_view
        return orbit.photo_camera(view.camera, self.editor.model) if view else None

    # Scenes and projects

    def open_scene(self, path: Path) -> None:
        """Open a scene, or an image of one; add its object to the library and show it.

        Reports an unreadable scene, or one of a model that is not open.
        """
        try:
            fingerprint = scene_model(path)
            scene = open_scene(path, self.models[fingerprint] if fingerprint else self.editor.model)
            self._add_models()
        except ValueError as error:
            self.messages.report("Cannot open the scene", error)
        else:
            self.editor.add_and_show(EditableObject(printable(path.stem), scene.instance), scene.camera)
            self.messages.notify(f"Opened {path.name}")

    def project(self) -> Project:
        """Return everything that was made as a project."""
        history = self.editor.history
        fitting = self.fitting
        objects = self.editor.objects
        used = frozenset[str]().union(*(state.mix.names | state.removed for state, _ in history.steps))
        kept = self.kept_objects.names
        saved = {added.name for added in objects.ever_added if added.name in used or added.name not in kept}
        roots = {objects.root(name) for name in saved}
        fit = FitHistory() if fitting.running and not fitting.results.checking else fitting.history
        return Project(
            history.without_gesture(),
            tuple(added for added in objects.ever_added if objects.root(added.name) in roots),
            fit if fit.sources else self._waiting[0],
            (*fitting.pending, *self._waiting[1]),
            self.models.names,
            self.models.files,
            self.originals,
            self.project_path,
        )

    @property
    def tracked_state(self) -> tuple[object, ...]:
        """The inputs of :meth:`project`; while they are identical objects, the project is the same."""
        fitting = self.fitting
        fit = fitting.request, fitting.queue, fitting.questions, fitting.results.checking, fitting.history.photos
        steps = None if fitting.running else fitting.history.steps
        named = self.editor.history, self.project_path, self.originals
        return (*named, *fit, steps, *self.editor.objects.ever_added)

    def restore(self, project: Project) -> None:
        """Take a project's objects, undo history and fits, as :meth:`Editor.restore`; report missing models."""
        self._add_models()
        self.editor.restore(project)
        self._restore_fits(project.fit, project.pending)
        self.originals = project.originals
        self._tell_missing(project)
        if self.viewport.source != "none":
            self.viewport.begin(self._pictures)

    def _tell_missing(self, project: Project) -> None:
        """Tell which models and which parts of a project are missing, and what becomes of them."""
        instances = [state.scene.instance for state, _ in project.history.steps]
        instances += [added.instance for added in project.objects]
        models = dict.fromkeys(instance.fingerprint for instance in instances if instance.is_missing)
        dismiss = (Button("OK", lambda: None),)
        for name in dict.fromkeys(self.model_name(model) for model in models):
            text = f"Not there: {name}. What was made with it waits in Mine; click its grey tile to find the file"
            self.messages.notify(text, MessageKind.NOTE, buttons=dismiss)
        for original in project.originals:
            text = f"Parts of {original.name} cannot be read: the rest is open, and the whole file is kept in Mine"
            self.messages.notify(text, MessageKind.NOTE, buttons=dismiss, detail="; ".join(original.reasons))

    def forget_original(self, original: Original) -> None:
        """Remove a project file with unreadable parts from the project."""
        self.originals = tuple(kept for kept in self.originals if kept is not original)

    def model_name(self, fingerprint: str) -> str:
        """Return the file name of a model that may be missing."""
        return Path(self.models.files.get(fingerprint, "")).name or "a model file"

    def save_project(self, path: Path) -> bool:
        """Save everything as a project file for any machine; report an error and return False if that fails."""
        try:
            self.project().shared().save(path, self.models)
        except Exception as error:
            self.messages.report("Cannot save the project", error)
            return False
        self.project_path = path
        self.messages.notify(f"Saved {path.name}")
        return True

    def open_project(self, path: Path, keep_path: bool = True) -> None:
        """Replace everything by a project file; report an unreadable one.

        Args:
            keep_path: save the project to this file later.
        """
        try:
            project = Project.load(path, self.models).beside(path.parent)
        except ValueError as error:
            self.messages.report("Cannot open the project", error)
        else:
            self._replace(project)
            self.project_path = path if keep_path else None
            self.messages.notify(f"Opened {path.name}")

    def new(self) -> None:
        """Begin a new project, in which fitted objects stay; the old one is archived with the removed ones."""
        self._replace(None)

    def _replace(self, project: Project | None) -> None:
        """Archive everything, and begin anew or with a project; photos that wait go on waiting."""
        unfinished = self.fitting.unfinished
        _, waiting = self._waiting
        self._end()
        if project:
            self.restore(project)
        self._waiting = self._waiting[0], (*self._waiting[1], *waiting)
        self.fitting.take_over(unfinished)

    def _end(self) -> None:
        """Archive the project without the photos that wait, and begin an empty one."""
        self.editor.end_gesture()
        before = replace(self.project(), pending=())
        if not before.is_empty:
            self.archive.emit(before)
        self.close()
        self.kept_objects.close()
        self.project_path = None
        self._begin(self.editor.model, self.viewport.settings)
        self.viewport.begin()
