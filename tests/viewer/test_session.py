import json
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from core.fitting.fit import FitJob, FitStep
from core.models.model import Model
from core.models.scene import Scene, save_image
from tests.conftest import random_model
from tests.viewer.driver import deliver, finish
from tests.viewer.stand_ins import endless_fit, quick_fit
from viewer.editor import Editor
from viewer.services.backend import Backend
from viewer.services.messages import MessageKind
from viewer.services.worker import Worker
from viewer.session import Session
from viewer.values import orbit
from viewer.values.project import Project
from viewer.values.share_settings import ShareSettings
from viewer.workspace import Workspace


def opened(session: Session) -> Workspace:
    assert session.workspace is not None
    return session.workspace


def test_a_model_opens_with_its_first_object_rendered(
    session: Session, editor: Editor, workspace: Workspace, model: Model
) -> None:
    assert editor.scene.codes == model.codes[0]
    assert editor.scene.camera == orbit.home(model)
    assert workspace.viewport.frame is not None
    assert workspace.viewport.frame.final
    assert session.messages.all == []


def test_nothing_is_there_before_the_model_is(worker: Worker, backend: Backend, tmp_path: Path) -> None:
    session = Session(worker, backend)
    session.tick()
    session.open_scene(tmp_path / "scene.json")
    assert session.workspace is None
    assert not session.project().sessions
    assert not session.fitting_runs
    assert not session.jobs.busy()


def test_a_model_that_cannot_be_opened_leaves_the_open_one(session: Session, editor: Editor) -> None:
    def missing(name: str) -> Model:
        raise ValueError(f"no model called {name!r}")

    before = editor.history
    session.jobs.backend = replace(session.jobs.backend, load_model=missing)
    session.open_model("tables")
    finish(session)
    assert editor.history is before
    assert session.messages.errors == ["Cannot open the model tables: no model called 'tables'"]


def test_what_was_made_stays_with_its_model(
    session: Session, editor: Editor, workspace: Workspace, photo: Path
) -> None:
    workspace.fitting.start(photo)
    finish(session, lambda: not workspace.fitting.running)
    workspace.player.add_key()
    before = editor.state
    session.open_model("other")
    finish(session)
    assert "block" not in opened(session).editor.objects.names
    session.open_model("chairs")
    finish(session)
    assert opened(session).editor.objects.names[0] == "block"
    assert opened(session).editor.state == before


def test_another_model_ends_nothing_unless_a_person_says_so(session: Session, photo: Path) -> None:
    session.jobs.backend = replace(session.jobs.backend, fit=endless_fit)
    session.fit_photos(photo)
    deliver(session, lambda: session.fitting_runs)
    session.change_model("chairs")
    assert session.messages.all == []
    session.change_model("other")
    assert (session.loading, session.model_name) == ("", "chairs")
    (asked,) = session.messages.all
    asked.buttons[0].press()
    finish(session, lambda: session.model_name == "other")
    session.change_model("chairs")
    deliver(session, lambda: session.model_name == "chairs" and session.fitting_runs)  # it goes on


def test_all_that_is_requested_while_another_model_loads_is_for_that(
    session: Session, editor: Editor, workspace: Workspace, photo: Path
) -> None:
    session.open_model("other")
    scene = photo.with_name("a.json")
    editor.scene.save(scene)
    session.open_scene(scene)
    session.fit_photos(photo)
    assert not session.fitting_runs
    finish(session, lambda: session.model_name == "other" and not session.fitting_runs)
    finish(session)
    assert {"a", "block"} <= {*opened(session).editor.objects.names}


def test_an_image_dropped_while_the_model_loads_is_fitted_then(worker: Worker, backend: Backend, photo: Path) -> None:
    session = Session(worker, backend)
    session.fit_photos(photo)
    session.open_model("chairs")
    finish(session, lambda: session.workspace is not None and not session.fitting_runs)
    assert opened(session).editor.objects.names[0] == "block"


def test_a_fit_waits_for_the_view_bank_which_is_made_once_the_model_is_there(
    worker: Worker, backend: Backend, photo: Path
) -> None:
    made, order = threading.Event(), list[str]()

    def view_bank(model: Model) -> Iterator[float]:
        yield 0.25
        while not made.is_set():
            yield 0.5
        order.append("made")
        yield 1.0

    def fit(model: Model, job: FitJob) -> Iterator[FitStep]:
        order.append("fitted")
        yield from quick_fit(model, job)

    session = Session(worker, replace(backend, view_bank=view_bank, fit=fit))
    session.open_model("chairs")
    session.fit_photos(photo)
    deliver(session, lambda: session.workspace is not None and session.workspace.preparing == 0.5)
    assert session.fitting_runs
    assert not order
    made.set()
    finish(session, lambda: not session.fitting_runs)
    finish(session)
    assert opened(session).preparing is None
    assert "made" in order[: order.index("fitted")]


def test_scenes_come_back_exactly(session: Session, editor: Editor, workspace: Workspace, tmp_path: Path) -> None:
    editor.sample("shape")
    editor.set_camera(orbit.dragged(editor.scene.camera, 0.123, 0.05))
    scene = editor.scene
    workspace.exporting.scene(tmp_path / "mine.json")
    editor.show_object("object 5")
    session.open_scene(tmp_path / "mine.json")
    assert editor.scene == scene
    assert editor.objects.names[0] == editor.state.mix.a.shape == editor.state.mix.a.texture == "mine"
    assert editor.objects.added[0].codes == scene.codes


def test_a_scene_dropped_while_the_model_loads_is_opened_then(
    session: Session, editor: Editor, workspace: Workspace, tmp_path: Path
) -> None:
    editor.sample("shape")
    workspace.exporting.scene(tmp_path / "mine.json")
    other = Session(session.jobs.worker, session.jobs.backend)
    other.open_scene(tmp_path / "mine.json")
    other.open_model("chairs")
    finish(other)
    assert opened(other).editor.scene == editor.scene


def test_a_scene_of_the_other_shipped_model_opens_that(
    worker: Worker, backend: Backend, model: Model, tmp_path: Path
) -> None:
    other = random_model(seed=5)
    assert other.fingerprint != model.fingerprint
    models = {"chairs": model, "cars": other}
    session = Session(worker, replace(backend, load_model=lambda name: models[name]), seed=0)
    scene = Scene(other.codes[2], other.camera(0.3, 0.2))
    scene.save(tmp_path / "a.json")
    save_image(np.zeros((8, 8, 3), np.uint8), tmp_path / "b.png", scene)
    session.open_model("chairs")
    finish(session)
    opened(session).editor.show_object("object 3")
    made = opened(session).editor.history
    for name in ("a.json", "b.png"):
        session.open_scene(tmp_path / name)
        finish(session, lambda: session.model_name == "cars" and not session.loading)
        assert session.messages.errors == []
        assert opened(session).editor.scene == scene
        session.open_model("chairs")
        finish(session)
        assert opened(session).editor.history == made
    assert len(session.project().sessions) == 2


def test_a_project_that_cannot_be_opened_changes_nothing(session: Session, editor: Editor, tmp_path: Path) -> None:
    editor.show_object("object 3")
    session.save_project(tmp_path / "no such folder" / "a.codenerf")
    assert session.messages.errors[-1].startswith("Cannot save the project")
    session.save_project(tmp_path / "a.codenerf")
    project = Project.load(tmp_path / "a.codenerf")
    (saved,) = project.sessions
    scene = replace(saved.history.now.scene, model="another")
    foreign = replace(saved, history=replace(saved.history, now=replace(saved.history.now, scene=scene)))
    Project("chairs", (foreign,)).save(tmp_path / "foreign.codenerf")
    Project("other", (replace(foreign, model="other"),)).save(tmp_path / "foreign other.codenerf")
    (tmp_path / "torn.codenerf").write_bytes((tmp_path / "a.codenerf").read_bytes()[:500])
    before = editor.history
    for name in ("foreign", "foreign other", "torn", "missing"):
        session.messages.clear()
        session.open_project(tmp_path / f"{name}.codenerf")
        finish(session)
        assert opened(session).editor.history is before, name
        assert len(session.messages.errors) == 1, name
    assert session.project_path == tmp_path / "a.codenerf"


def test_a_model_that_is_asked_for_while_a_project_loads_opens_after_it(
    session: Session, editor: Editor, tmp_path: Path
) -> None:
    editor.show_object("object 2")
    made = editor.state
    session.save_project(tmp_path / "a.codenerf")
    session.open_model("cars")
    finish(session)
    session.open_project(tmp_path / "a.codenerf")
    session.open_model("cars")
    finish(session, lambda: session.model_name == "cars")
    assert not session.messages.errors
    assert session.project_path == tmp_path / "a.codenerf"
    session.open_model("chairs")
    finish(session)
    assert session.workspace is not None
    assert session.workspace.editor.state == made


def test_scenes_that_cannot_be_opened_change_nothing(
    session: Session, editor: Editor, workspace: Workspace, tmp_path: Path
) -> None:
    workspace.exporting.scene(tmp_path / "scene.json")
    about = json.loads((tmp_path / "scene.json").read_text())
    (tmp_path / "other.json").write_text(json.dumps(about | {"model": "0" * 16}))
    (tmp_path / "short.json").write_text(json.dumps(about | {"shape": [1.0]}))
    (tmp_path / "nan.json").write_text(json.dumps(about | {"shape": [float("nan")] * 8}))
    (tmp_path / "camera.json").write_text(json.dumps(about | {"camera": about["camera"] | {"distance": -1}}))
    (tmp_path / "list.json").write_text("[1, 2]")
    (tmp_path / "binary.json").write_bytes(bytes(range(256)))
    before = editor.history
    for name in ("other", "short", "nan", "camera", "list", "binary", "missing"):
        session.messages.clear()
        session.open_scene(tmp_path / f"{name}.json")
        finish(session)
        assert editor.history is before, name
        assert len(session.messages.errors) == 1, name
    workspace.exporting.scene(tmp_path / "no such folder" / "scene.json")
    assert session.messages.errors[-1].startswith("Cannot save the scene")


def test_a_photo_of_another_category_waits_for_the_export_unless_it_is_given_up(
    session: Session, workspace: Workspace, photo: Path, tmp_path: Path
) -> None:
    def slow(*_: object) -> Iterator[int]:
        while True:
            time.sleep(0.01)
            yield 0

    other, backend, here = replace(random_model(1), category="cars"), session.jobs.backend, workspace.model
    session.jobs.backend = replace(
        backend,
        load_model=lambda name: other if name == "cars" else here,
        guess_category=lambda _: {"cars": 0.95, "chairs": 0.01},
        video=slow,
    )
    workspace.exporting.share(tmp_path / "turn.mp4", ShareSettings())
    session.fit_photos(photo)
    deliver(session, lambda: bool(session.messages.all))
    (said,) = session.messages.all
    assert said.text.endswith("that model opens for it once turn.mp4 is saved")
    session.tick()
    assert session.model_name == "chairs" and workspace.exporting.running
    assert [button.label for button in said.buttons] == ["Do it now", "Rebuild as chairs anyway"]
    said.buttons[0].press()
    finish(session, lambda: session.model_name == "cars" and not session.fitting_runs)
    assert opened(session).editor.objects.names[0] == "block"


def test_a_photo_of_another_category_is_fitted_with_the_model_of_that(
    session: Session, editor: Editor, photo: Path
) -> None:
    other, before = replace(random_model(1), category="cars"), editor.history
    backend, here = session.jobs.backend, editor.model
    session.jobs.backend = replace(
        backend,
        load_model=lambda name: other if name == "cars" else here,
        guess_category=lambda _: {"cars": 0.95, "chairs": 0.01},
    )
    session.fit_photos(photo)
    while session.model_name != "cars":
        session.tick()
    finish(session, lambda: not session.fitting_runs)
    assert opened(session).editor.objects.names[0] == "block"
    said = "block.png looks like cars, not chairs: that model opens for it"
    assert said in [one.text for one in session.messages.log]
    assert said not in [one.text for one in session.messages.shown]
    session.open_model("chairs")
    finish(session, lambda: session.model_name == "chairs")
    assert "block" not in opened(session).editor.objects.names
    assert opened(session).editor.history == before


def test_a_person_may_insist_on_a_category(session: Session, photo: Path) -> None:
    """Before the other model opens, and after it has made something else of the photo."""
    models = {"chairs": opened(session).model, "cars": replace(random_model(1), category="cars")}
    session.jobs.backend = replace(
        session.jobs.backend,
        load_model=models.__getitem__,
        guess_category=lambda _: {"cars": 0.95, "chairs": 0.01},
    )
    session.fit_photos(photo)
    deliver(session, lambda: any(one.buttons for one in session.messages.all))
    (note,) = (one for one in session.messages.all if one.buttons)
    assert note.buttons[0].label == "Rebuild as chairs anyway"
    while session.model_name != "cars":
        session.tick()
    finish(session, lambda: not session.fitting_runs)
    note.buttons[0].press()
    while session.model_name != "chairs":
        session.tick()
    finish(session, lambda: not session.fitting_runs)
    assert opened(session).editor.objects.own == ["block"]
    assert opened(session).fitting.history.sources[0].category == "chairs"


def test_a_photo_of_nothing_known_is_fitted_unless_a_person_stops_it(session: Session, photo: Path) -> None:
    session.jobs.backend = replace(session.jobs.backend, guess_category=lambda _: {"cars": 0.1, "chairs": 0.05})
    session.fit_photos(photo)
    finish(session, lambda: not session.fitting_runs)
    assert opened(session).editor.objects.names[0] == "block"
    (note,) = [one for one in session.messages.all if one.text == "block: this does not look like a chair"]
    assert note.kind is MessageKind.NOTE
    before = opened(session).fitting.history
    session.jobs.backend = replace(session.jobs.backend, fit=endless_fit)
    session.fit_photos(photo)
    deliver(session, lambda: len(opened(session).fitting.history.steps) > 3)
    note.buttons[1].press()  # of a fit that is over: nothing happens
    assert session.fitting_runs
    stop = session.messages.all[-1].buttons[1]
    assert stop.label == "Stop"
    stop.press()
    assert not session.fitting_runs
    assert opened(session).fitting.history is before
    assert opened(session).editor.objects.own == ["block"]
