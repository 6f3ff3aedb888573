"""A run of the program apart from its window: the editor, its activities, and their saved state."""

from collections.abc import Callable, Mapping
from itertools import zip_longest
from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8

from core.editing.words import Words
from core.geometry.camera import Camera
from core.models.library import DEFAULT_MODEL, sample_images, shipped_models
from core.models.model import Model
from core.models.open_models import OpenModels
from core.models.photo_detail import PhotoView
from core.models.scene import Scene, scene_model
from viewer.activities.answers import Answers
from viewer.activities.exporting import Exporting
from viewer.activities.fit_stream import FitOptions
from viewer.activities.fitting import Fitting
from viewer.activities.names import Names
from viewer.activities.painting import Painting
from viewer.activities.recording import Recording
from viewer.activities.reshaping import Reshaping
from viewer.activities.segmenting import Segmenting
from viewer.activities.thumbnails import Thumbnails
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.backend import Backend
from viewer.services.jobs import BACKGROUND_WEIGHT, Jobs
from viewer.services.latest import Memo
from viewer.services.messages import OK, Button, MessageKind, Messages
from viewer.services.photo_thumbnails import photo_thumbnail
from viewer.services.worker import Job, Worker
from viewer.store.files import read_project
from viewer.store.pictures import Pixels
from viewer.store.store import CRASHED, Earlier, Store
from viewer.values import orbit
from viewer.values.fit_history import FitHistory, FitRequest
from viewer.values.objects import EditableObject
from viewer.values.printable import printable
from viewer.values.project import Project
from viewer.values.view_request import ViewSettings

_JOBS = (
    *("view", "bake", "fit view", "framing", "thumbnails", "segmentation"),
    *("paint", "paint colour", "coarse paint", "parts", "size"),
)  # of the activities


class Session:
    """Creates and connects editor and activities; opens, saves and replaces projects."""

    def __init__(
        self,
        worker: Worker,
        backend: Backend | None = None,
        seed: int | None = None,
        folder: Path | None = None,
        first: str = DEFAULT_MODEL,
        display: str = "",
    ) -> None:
        """Open the shipped models and show the first object of one.

        Args:
            folder: folder of the work kept between launches; None keeps nothing.
            first: name of a shipped model, or path of another one.
            display: name of the window's display.

        Raises ``ValueError`` if a model cannot be opened.
        """
        backend = backend or Backend()
        self.messages = Messages()
        self.models = OpenModels(backend.load_model)
        self.jobs = Jobs(worker, backend, self.messages, self.models)
        self.photo_thumbnails = Memo(self.jobs, "photo", photo_thumbnail)
        self.fit_options = FitOptions()
        self.project_path: Path | None = None  # file of the saved or opened project
        self.store = Store(folder, display)
        self._pictures = self.store.pictures()  # images of the last launch
        self._stored_pictures: tuple[object, ...] = (None, 0)  # frame of the view, number of tiles
        self.recording = Recording(
            self.store, self.messages, self.project, lambda: self.tracked_state, self._new_pictures
        )
        self._generator = torch.Generator()
        self._generator.manual_seed(seed) if seed is not None else self._generator.seed()
        measure = self.jobs.backend.direction_words  # such as *wider*, of both codes' directions
        self.words = Memo[Model, Words](self.jobs, "words", measure, BACKGROUND_WEIGHT)
        for name in dict.fromkeys((*shipped_models(), first)):
            self.models.open(name)
        self._begin(self.models.open(first), ViewSettings())
        self.exporting = Exporting(self.jobs, self.editor, self.names)

    def _begin(self, first: Model, view: ViewSettings) -> None:
        """Create editor and activities in their initial state, with the kept objects."""
        jobs = self.jobs
        self.editor = Editor(self.models, first, self._generator)
        self._add_mine()
        self._waiting = tuple[FitRequest, ...]()  # of models that are missing
        self.viewport = Viewport(jobs, self.editor, view)
        self.thumbnails = Thumbnails(jobs, self._pictures)
        self.names = Names(self.editor, self.words.get)
        self.fitting = Fitting(jobs, self.editor, self.viewport, self.fit_options, self.store)
        self.answers = Answers(self.fitting, self.store.copies)
        self.segmenting = Segmenting(jobs, self.fitting.fit)
        self.reshaping = Reshaping(jobs, self.editor, self.viewport)
        self.painting = Painting(jobs, self.editor, self.viewport, self.reshaping)

    def _add_mine(self) -> None:
        """Add the objects of *Mine* and open their models."""
        objects, files = self.store.mine()
        for fingerprint, file in files.items():
            self.models.expect(fingerprint, file)
        objects = tuple(item.converted(self.models.adopt) for item in objects)
        for model in self.models:
            if model.fingerprint not in self.editor.objects.families:
                self.editor.add_model(model)
        self.editor.objects.match(objects)
        added = self.editor.objects.ever_added
        self._mine = frozenset(item.key for item in added)
        self.store.know(added)

    def resume(self) -> None:
        """Go on with the last session that no window has."""
        number = self.store.resume()
        if number is not None:
            project = self._restore(self.store.session(number, self.editor.state))
            self.project_path = None if project.lost else project.path

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
        self.recording.tick(at_rest=not self.editor.history.gesture)

    def close(self) -> None:
        """Cancel all jobs of the activities but an export."""
        self.fitting.close()
        self.jobs.cancel(*_JOBS)

    # Models and their objects

    def open_model(self, name: str, expected: str = "", show: Callable[[], None] | None = None) -> None:
        """Open a model by its shipped name or path in the background, then ``show`` it: by default its first object.

        ``expected`` is the fingerprint of the missing model that it should be; empty for any model.
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

        ended = self.jobs.reporting("Cannot open the model")
        self.jobs.submit(Job(f"model {name}", lambda: (load(name),), loaded, ended))

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
            self._restore_fits(self._waiting)

    def _restore_fits(self, pending: tuple[FitRequest, ...]) -> None:
        """Continue requests; those of missing models wait for them."""
        adopt = self.models.adopt

        def is_there(history: FitHistory) -> bool:
            return not history.model or self.models.find(history.model) is not None

        self._waiting = tuple(request for request in pending if not is_there(request.history))
        due = (request for request in pending if is_there(request.history))
        self.fitting.restore(tuple(request._replace(history=request.history.converted(adopt)) for request in due))

    def rename(self, name: str, to: str) -> None:
        """Rename an added object everywhere."""
        new = self.editor.rename(name, to)
        self.fitting.results.rename(name, new)

    def remove(self, *names: str) -> None:
        """Remove added objects, versions of one, from all lists, even if on screen, and offer to undo that."""
        editor = self.editor
        editor.unlist(editor.state.removed.union(names))
        for name in names:
            self.fitting.results.unseen.discard(name)
        history = editor.history

        def undo() -> None:
            editor.undo() if editor.history is history else editor.unlist(editor.state.removed.difference(names))

        def relevant() -> bool:
            return self.editor is editor and editor.objects.removed.issuperset(names)

        label = self.names.label(names[0])
        self.messages.notify(f"Removed {label}", buttons=(Button("Undo", undo),), relevant=relevant)

    def _new_pictures(self) -> Callable[[], Mapping[str, Pixels]] | None:
        """Return a function that makes the last images of view and tiles; None if they are stored or not finished."""
        newest = self.viewport.frame, self.thumbnails.rendered
        if newest[0] is self._stored_pictures[0] and newest[1] == self._stored_pictures[1]:
            return None
        self._stored_pictures = newest
        view = self.viewport.picture()
        tiles = self.thumbnails.newest()
        return lambda: tiles() | view()

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
            self.viewport.framing.frame(self.viewport.settings.panel)

    @property
    def photo_view(self) -> PhotoView | None:
        """The selected photo of the object on screen, if its photo detail has that photo."""
        detail = self.editor.scene.instance.detail
        fit = self.fitting.shown
        if detail is None or not fit.photos:
            return detail.views[0] if detail else None
        left_out = fit.last.left_out if fit.last else ()
        included = [number for number in range(len(fit.photos)) if number not in left_out]
        return dict(zip(included, detail.views, strict=False)).get(fit.photo_index)

    @property
    def whole_photo(self) -> UInt8[np.ndarray, "height width 3"] | None:
        """The whole photo of :attr:`photo_view` with the outline of the cut-out, if it is kept."""
        fit = self.fitting.shown
        if self.photo_view is None or not fit.last:
            return None
        return fit.photo.preview.pixels if fit.photo and fit.photo.preview else None

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
            scene = Scene.load(path, self.models[fingerprint] if fingerprint else self.editor.model)
            self._add_models()
        except ValueError as error:
            self.messages.report("Cannot open the scene", error)
        else:
            self.editor.add_and_show(EditableObject(printable(path.stem), scene.instance), scene.camera)

    def project(self) -> Project:
        """Return everything that was made as a project."""
        return Project(
            self.editor.history.without_gesture(),
            self.editor.objects.ever_added,
            self.fitting.view.made,
            (*self.fitting.pending, *self._waiting),
            self.models.files,
            self.project_path,
            self._mine,
        )

    @property
    def tracked_state(self) -> tuple[object, ...]:
        """The inputs of :meth:`project`; while they are identical objects, the project is the same."""
        fitting = self.fitting
        fits = (
            fitting.request,
            fitting.waiting.requests,
            fitting.questions,
            fitting.results.checking,
            fitting.history.photos,
        )
        named = self.editor.history, self.project_path, fitting.view.made
        return (*named, *fits, *self.editor.objects.ever_added)

    def _restore(self, project: Project, folder: Path | None = None) -> Project:
        """Take a project's objects, undo history and fits, report missing models, and return it with its models."""
        project = project.adopted(self.models, folder)
        self._add_models()
        keys = self.editor.restore(project)
        self.fitting.view.take({keys[key]: fit for key, fit in project.fits.items()})
        self._restore_fits(project.pending)
        self._tell_missing(project)
        if self.viewport.source != "none":
            self.viewport.begin(self._pictures)
        return project

    def _tell_missing(self, project: Project) -> None:
        """Tell which models and which parts of a project are missing, and what becomes of them."""
        instances = [state.scene.instance for state, _ in project.history.steps.values()]
        instances += [added.instance for added in project.objects]
        models = dict.fromkeys(instance.fingerprint for instance in instances if instance.is_missing)
        for name in dict.fromkeys(self.model_name(model) for model in models):
            text = f"Not there: {name}. What was made with it waits in Mine; click its grey tile to find the file"
            self.messages.notify(text, MessageKind.NOTE, buttons=OK)
        if project.lost:
            text = "Parts of it cannot be read: the rest is open"
            self.messages.notify(text, MessageKind.NOTE, buttons=OK, detail="; ".join(project.lost[:3]))

    def model_name(self, fingerprint: str) -> str:
        """Return the file name of a model that may be missing."""
        return Path(self.models.files.get(fingerprint, "")).name or "a model file"

    def save_project(self, path: Path) -> bool:
        """Save everything as a project file for any machine; report an error and return False if that fails."""
        try:
            self.store.save(self.project(), path)
        except Exception as error:
            self.messages.report("Cannot save the project", error)
            return False
        self.project_path = path
        self.messages.notify(f"Saved {path.name}")
        return True

    def open_project(self, path: Path) -> None:
        """Replace everything by a project file; report an unreadable one.

        The project is saved to the file later, unless parts of it could not be read.
        """
        try:
            project = read_project(path, self.editor.state, self.store.copies)
        except ValueError as error:
            self.messages.report("Cannot open the project", error)
        else:
            self._replace(project, path.parent)
            self.project_path = None if project.lost else path

    def open_earlier(self, session: Earlier) -> None:
        """Replace everything by a session that was replaced before."""
        self.messages.all = [message for message in self.messages.all if message.text != CRASHED]
        self._replace(self.store.session(session.number, self.editor.state))

    def new(self) -> None:
        """Begin a new project, in which fitted objects stay; the old one becomes an earlier session."""
        self._replace(None)

    def _replace(self, project: Project | None, folder: Path | None = None) -> None:
        """Set everything aside, and begin anew or with a project; photos that wait go on waiting."""
        unfinished = self.fitting.unfinished
        waiting = self._waiting
        self.editor.end_gesture()
        self.close()
        self._waiting = ()
        self.recording.archive()
        self.project_path = None
        self._begin(self.editor.model, self.viewport.settings)
        self.exporting.begin(self.editor, self.names)
        self.viewport.begin()
        if project:
            self._restore(project, folder)
        self._waiting = (*self._waiting, *waiting)
        self.fitting.take_over(unfinished)
