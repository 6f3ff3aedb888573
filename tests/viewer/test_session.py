import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from core.fitting.fit import FitJob, FitStep
from core.models.model import Instance, Model
from core.models.scene import Scene, save_image
from tests.conftest import open_models, random_model
from tests.viewer.driver import finish, fit
from tests.viewer.stand_ins import blue_block, quick_fit, shifted
from viewer.editor import Editor
from viewer.services.backend import Backend
from viewer.services.worker import Worker
from viewer.session import Session
from viewer.store.files import read_project
from viewer.store.store import Store
from viewer.values import orbit
from viewer.values.fit_history import FitHistory, FitRequest
from viewer.values.objects import EditableObject
from viewer.values.project import Project
from viewer.values.share_settings import ShareSettings


def test_a_model_opens_with_its_first_object_rendered(session: Session, editor: Editor, model: Model) -> None:
    assert editor.scene.instance == model[0]
    assert editor.scene.camera == orbit.home(model)
    assert session.viewport.frame.final
    assert session.messages.all == []


def test_a_view_bank_is_built_in_steps_before_the_first_photo(worker: Worker, backend: Backend, photo: Path):
    order = list[str]()

    def view_bank(model: Model) -> Iterator[float]:
        for step in range(1, 4):
            order.append("built")
            yield step / 3

    def noted_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
        order.append("fitted")
        yield from quick_fit(model, job)

    session = Session(worker, replace(backend, view_bank=view_bank, fit=noted_fit))
    session.start()
    finish(session)
    assert not order
    fit(session, photo)
    assert order == ["built"] * 3 + ["fitted"]


def test_scenes_come_back_exactly(session: Session, editor: Editor, tmp_path: Path) -> None:
    editor.sample()
    editor.set_camera(orbit.dragged(editor.scene.camera, 0.123, 0.05))
    scene = editor.scene
    editor.scene.save(tmp_path / "mine.json")
    editor.show_object("object 5")
    session.open_scene(tmp_path / "mine.json")
    assert editor.scene == scene
    assert editor.objects.own[0] == editor.state.mix.a.shape == editor.state.mix.a.texture == "mine"
    assert editor.objects.added[0].instance == scene.instance


def test_a_project_that_cannot_be_opened_changes_nothing(session: Session, editor: Editor, tmp_path: Path) -> None:
    editor.show_object("object 3")
    session.save_project(tmp_path / "no such folder" / "a.codenerf")
    assert session.messages.errors[-1].startswith("Cannot save the project")
    session.save_project(tmp_path / "a.codenerf")
    (tmp_path / "torn.codenerf").write_bytes((tmp_path / "a.codenerf").read_bytes()[:500])
    history = editor.history
    for name in ("torn", "missing"):
        session.messages.all.clear()
        session.open_project(tmp_path / f"{name}.codenerf")
        finish(session)
        assert session.editor.history is history, name
        assert len(session.messages.errors) == 1, name
    assert session.project_path == tmp_path / "a.codenerf"


def test_scenes_that_cannot_be_opened_change_nothing(session: Session, editor: Editor, tmp_path: Path) -> None:
    session.editor.scene.save(tmp_path / "scene.json")
    fields = json.loads((tmp_path / "scene.json").read_text())
    (tmp_path / "other.json").write_text(json.dumps(fields | {"model": "0" * 16}))
    (tmp_path / "short.json").write_text(json.dumps(fields | {"shape": [1.0]}))
    (tmp_path / "nan.json").write_text(json.dumps(fields | {"shape": [float("nan")] * 8}))
    (tmp_path / "camera.json").write_text(json.dumps(fields | {"camera": fields["camera"] | {"distance": -1}}))
    (tmp_path / "list.json").write_text("[1, 2]")
    (tmp_path / "binary.json").write_bytes(bytes(range(256)))
    history = editor.history
    for name in ("other", "short", "nan", "camera", "list", "binary", "missing"):
        session.messages.all.clear()
        session.open_scene(tmp_path / f"{name}.json")
        finish(session)
        assert editor.history is history, name
        assert len(session.messages.errors) == 1, name


def test_photos_are_fitted_with_their_categories_models(worker: Worker, both: Backend, photo: Path) -> None:
    session = Session(worker, both, seed=0)
    editor = session.editor
    cars, chairs = session.models
    session.fitting.start(photo)
    fit(session, blue_block(photo))
    assert {added.name: added.instance.model for added in editor.objects.added} == {"block": chairs, "block blue": cars}
    assert editor.model is chairs  # the second was not followed
    editor.show_object("block blue")
    assert session.fitting.shown.model == cars.fingerprint
    editor.mix_both(0.0, 0.5)
    assert editor.model is cars and editor.state.mix.b.startswith("car")
    session.exporting.share(photo.with_name("car.gif"), ShareSettings("turntable", size=16))
    finish(session, lambda: not session.exporting.running)
    assert photo.with_name("car.gif").is_file() and session.messages.errors == []
    editor.show_object("block")
    assert [message.text for message in session.messages.all if "model" in message.text] == []
    for _ in range(len(editor.history.past)):
        editor.undo()
    assert editor.model is chairs


def test_a_person_may_fit_a_photo_as_another_category(worker: Worker, both: Backend, photo: Path) -> None:
    session = Session(worker, both, seed=0)
    cars, chairs = session.models
    fit(session, photo)
    session.fitting.refit(cars)
    finish(session, lambda: not session.fitting.pending)
    assert [added.instance.model for added in session.editor.objects.added] == [chairs, cars]
    history = session.fitting.shown
    session.segmenting.open(history.sources, 0, history.model)
    session.segmenting.fit()  # cut out again, it is a car still
    finish(session, lambda: not session.fitting.pending)
    assert session.editor.model is cars


def test_a_model_file_joins_the_library(session: Session, editor: Editor, model: Model, tmp_path: Path) -> None:
    stools = replace(random_model(7), category="stools")
    history = editor.history
    session.jobs.backend = replace(session.jobs.backend, load_model=lambda name: stools)
    (tmp_path / "stools.safetensors").touch()
    session.open_model(str(tmp_path / "stools.safetensors"))
    finish(session)
    assert editor.model is stools and editor.scene.instance == stools[0]
    assert editor.history.past == (history.now,)
    editor.undo()
    assert editor.model is model
    session.save_project(tmp_path / "a.codenerf")
    backend = replace(session.jobs.backend, load_model=by_name(model, stools=stools))
    again = Session(session.jobs.worker, backend, seed=0)
    again.open_project(tmp_path / "a.codenerf")
    assert again.messages.errors == []
    assert again.editor.history == editor.history


def test_a_model_that_cannot_be_opened_changes_nothing(session: Session, editor: Editor) -> None:
    def missing(name: str) -> Model:
        raise ValueError(f"no model called {name!r}")

    history = editor.history
    session.jobs.backend = replace(session.jobs.backend, load_model=missing)
    session.open_model("tables")
    finish(session)
    assert editor.history is history
    assert session.messages.errors == ["Cannot open the model: no model called 'tables'"]


def test_a_scene_of_any_open_model_opens(worker: Worker, both: Backend, tmp_path: Path) -> None:
    session = Session(worker, both, seed=0)
    cars, _ = session.models
    scene = Scene(cars[2], cars.camera(0.3, 0.2))
    scene.save(tmp_path / "a.json")
    save_image(np.zeros((8, 8, 3), np.uint8), tmp_path / "b.png", scene)
    for name in ("a.json", "b.png"):
        session.editor.show_object("object 3")
        session.open_scene(tmp_path / name)
        assert session.messages.errors == []
        assert session.editor.scene == scene


def by_name(model: Model, **models: Model) -> Callable[[str], Model]:
    return lambda name: models.get(Path(name).stem, model)


def test_a_photo_of_nothing_known_is_fitted_once_a_person_says_so(session: Session, photo: Path) -> None:
    session.jobs.backend = replace(session.jobs.backend, guess_category=lambda _: {"cars": 0.1, "chairs": 0.05})
    fit(session, photo)
    (question,) = session.fitting.questions
    assert question.words == "This does not look like a chair"
    assert session.editor.objects.own == []
    session.answers.answer(question)
    finish(session, lambda: not session.fitting.pending)
    assert session.editor.objects.own == ["block"]
    assert session.messages.errors == []


def saved_stool(session: Session, stools: Model, path: Path) -> tuple[int, int]:
    """Edit a stool twice, the second time from before the first, show a chair and save; return both steps of undo."""
    session.models.open("stools")
    session.tick()
    editor = session.editor
    editor.show_object(editor.objects.add(EditableObject("stool", stools[1], True)))
    for shift in (1.0, 2.0):
        editor.edit(editor.scene.instance.changed(texture=stools.codes[1].texture + shift))
        editor.undo()
    (branch,) = editor.history.branches()
    editor.redo()
    last = editor.history.current
    editor.show_object("object 3")
    session.save_project(path)
    return branch.last, last


def test_edits_and_branches_of_a_missing_model_wait_for_one_that_extends_it(
    worker: Worker, backend: Backend, model: Model, tmp_path: Path
) -> None:
    stools = replace(random_model(9), category="stools")
    extension = replace(random_model(11), extends=(stools.fingerprint,), category="stools")
    files: dict[str, Model] = {"chairs": model, "stools": stools}
    backend = replace(backend, load_model=lambda name: files.get(name, model))
    session = Session(worker, backend, seed=0, folder=tmp_path)
    steps = saved_stool(session, stools, tmp_path / "a.codenerf")
    made = session.editor.history
    del files["stools"]

    session = Session(worker, backend, seed=0, folder=tmp_path)
    session.open_project(tmp_path / "a.codenerf")
    editor = session.editor
    assert session.messages.errors == [] and editor.objects.own == ["stool"]
    for number in (editor.history.current, *steps):
        editor.go_to(number)
        assert editor.history == made  # neither step can be shown
    stool = editor.objects["stool"]
    assert stool.instance == made.steps[steps[1]].state.scene.instance and stool.original == stools[1]
    session.save_project(tmp_path / "b.codenerf")

    session.models.add("after", extension)
    session.tick()
    for number in steps:
        editor.go_to(number)
        assert editor.scene.instance == Instance(extension, made.steps[number].state.scene.instance.codes)
        assert editor.objects["stool"].instance == editor.scene.instance
    assert [instance.fingerprint for instance in editor.objects["stool"].ends] == [extension.fingerprint] * 2
    editor.reset()
    assert editor.scene.instance == Instance(extension, stools.codes[1])

    files["stools"] = stools
    session = Session(worker, backend, seed=0)
    session.models.open("stools")
    session.open_project(tmp_path / "b.codenerf")
    assert session.editor.history == made
    assert session.editor.objects["stool"].instance == stool.instance


def test_objects_keep_their_order_over_launches(worker: Worker, backend: Backend, model: Model, tmp_path: Path) -> None:
    stools = replace(random_model(9), category="stools")
    files: dict[str, Model] = {"chairs": model, "stools": stools}
    backend = replace(backend, load_model=lambda name: files.get(Path(name).stem, model))

    def launched() -> Session:
        session = Session(worker, backend, seed=0, folder=tmp_path)
        session.resume()
        return session

    session = launched()
    session.models.open("stools")
    session.tick()
    objects = session.editor.objects
    for number in range(1, 5):  # every third was opened, not fitted
        objects.add(EditableObject(f"{number}", (model, stools)[number % 2][number], number % 3 > 0))
    objects.version("2", model[0])
    session.rename("1", "renamed")
    order = ["4", "3", "2", "renamed"]
    assert objects.own == order
    session.recording.close()

    for is_there in (True, False):
        files |= {"stools": stools if is_there else model}
        session = launched()
        assert session.editor.objects.own == order
        assert session.editor.objects.versions("2") == ["2", "2 (2)"]
        if is_there:
            session.recording.close()
    session.models.add("stools", stools)
    session.tick()
    assert session.editor.objects.own == order
    assert not session.editor.objects.is_missing("renamed")


def test_edits_of_a_missing_model_here_and_in_a_project_are_both_kept(
    worker: Worker, backend: Backend, model: Model, tmp_path: Path
) -> None:
    stools = replace(random_model(9), category="stools")
    editor = Editor(open_models(model, stools), model, torch.Generator())
    editor.show_object(editor.objects.add(EditableObject("stool", stools[1], True)))
    editor.edit(editor.scene.instance.changed(texture=stools.codes[1].texture + 1.0))
    Store().save(Project(editor.history, editor.objects.ever_added), tmp_path / "a.codenerf")

    editor = Editor(open_models(model), model, torch.Generator())
    saved = read_project(tmp_path / "a.codenerf").adopted(editor.models)
    original = saved.objects[0].original
    edited = shifted(original, 2.0)
    here = EditableObject("stool", original, True, key=saved.objects[0].key).left_as(edited)
    editor.objects.add(here)
    editor.restore(saved)
    assert editor.objects["stool"].instance == saved.objects[0].instance
    editor.models.add("stools", stools)
    editor.add_model(stools)
    editor.show_object(editor.objects.versions("stool")[1])
    assert not editor.scene.instance.is_missing
    assert editor.scene.instance == here.instance


def test_without_any_state_that_can_be_shown_work_goes_on_after_them(model: Model) -> None:
    stools = replace(random_model(9), category="stools")
    editor = Editor(open_models(stools), stools, torch.Generator())
    name = editor.objects.add(EditableObject("stool", stools[1], True))
    editor.show_object(name)
    editor.unlist(frozenset({name}))
    saved = Project(editor.history, editor.objects.ever_added)

    editor = Editor(open_models(model), model, torch.Generator())
    scene = editor.scene
    editor.restore(saved)
    assert editor.scene == scene and editor.objects.own == []
    assert editor.history.past == saved.history.states
    editor.undo()
    editor.redo()
    assert editor.scene == scene
    editor.models.add("stools", stools)
    editor.add_model(stools)
    editor.undo()
    editor.undo()
    assert editor.objects.own == ["stool"] and editor.model is stools


def test_fits_of_a_missing_model_wait_for_it(worker: Worker, both: Backend, photo: Path, tmp_path: Path) -> None:
    cars = both.load_model("cars")
    session = Session(worker, both, seed=0)
    fit(session, blue_block(photo))
    made = session.project()
    (finished,) = made.fits.values()
    waiting = FitRequest(FitHistory(finished.sources, finished.photos, model=cars.fingerprint))
    Store().save(replace(made, pending=(waiting,), model_files={}), tmp_path / "a.codenerf")

    def chairs(name: str) -> Model:
        return both.load_model("chairs")

    without = Session(worker, replace(both, load_model=chairs), seed=0)
    without.open_project(tmp_path / "a.codenerf")
    finish(without)
    assert without.messages.errors == [] and not without.fitting.pending
    again = without.project()
    assert len(again.pending) == 1
    assert [len(stored_fit.steps) for stored_fit in again.fits.values()] == [len(finished.steps)]
    assert without.editor.objects.is_missing("block blue")

    without.jobs.backend = both
    without.open_model("cars")
    finish(without, lambda: not without.fitting.pending)
    assert without.editor.objects.own == ["block blue (2)", "block blue"]
    assert not without.editor.objects.is_missing("block blue") and without.messages.errors == []
    assert not without.project().pending
