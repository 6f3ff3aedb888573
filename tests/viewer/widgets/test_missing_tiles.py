from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.models.model import Model
from core.models.open_models import OpenModels
from tests.conftest import random_model
from tests.viewer.driver import Drive, Driver
from viewer.services.backend import Backend
from viewer.services.worker import Worker
from viewer.session import Session
from viewer.store.files import read_project
from viewer.values.objects import EditableObject
from viewer.values.project import Project


@pytest.fixture
def stools(tmp_path: Path) -> Path:
    """The file of a person's own model."""
    model = replace(random_model(9), category="stools")
    model.save(tmp_path / "stools.safetensors")
    return tmp_path / "stools.safetensors"


@pytest.fixture
def file_backend(backend: Backend, model: Model) -> Backend:
    """The shipped model, and models of files."""
    return replace(backend, load_model=lambda name: Model.load(Path(name)) if Path(name).suffix else model)


def make(session: Session, stools: Path) -> None:
    """A chair, a fitted stool, an edit of the stool, and a chair again."""
    editor = session.editor
    editor.show_object("object 2")
    model = session.models.open(str(stools))
    session.tick()
    name = editor.objects.add(EditableObject("Red stool", model[1], True, 0.8))
    editor.show_object(name)
    editor.mix_both(0.0, 0.5)
    editor.show_object("object 3")
    session.tick()


@pytest.fixture
def made(worker: Worker, file_backend: Backend, stools: Path, tmp_path: Path) -> Project:
    """A project with them in ``a.codenerf``, and the same kept in a folder for the next launch."""
    folder = tmp_path / "config"
    folder.mkdir()
    session = Session(worker, file_backend, 0, folder)
    make(session, stools)
    session.save_project(tmp_path / "a.codenerf")
    session.recording.close()
    assert session.messages.errors == []
    return session.project()


def find(window: Driver, widget: str, path: Path) -> None:
    """Click a grey tile and answer with the path of the model."""
    window.click(widget)
    window.type(str(path))
    window.wait()


def test_what_was_made_with_a_deleted_model_waits_as_grey_tiles_and_comes_back(
    drive: Drive, file_backend: Backend, made: Project, stools: Path, tmp_path: Path
) -> None:
    moved = stools.rename(tmp_path / "elsewhere.safetensors")

    def act(window: Driver) -> None:
        assert window.session.messages.errors == []
        assert "stools.safetensors" in window.session.messages.newest.text
        assert window.editor.state.mix.a.shape == "object 3"
        assert window.editor.objects.own == ["Red stool"]
        tile = window.ctx.item_info("//Library/**/show Red stool").rect_full
        grey = window.capture()[int(tile.min.y) + 3 : int(tile.min.y) + 20, int(tile.min.x) + 3 : int(tile.max.x) - 3]
        assert np.ptp(grey, -1).max() < 16  # no picture, no colour
        window.undo()
        assert window.editor.state.mix.a.shape == "object 2"  # the states of the stool are skipped
        window.redo()
        assert window.editor.state.mix.a.shape == "object 3"
        assert window.session.save_project(tmp_path / "b.codenerf")
        find(window, "Library/**/show Red stool", moved)
        assert window.editor.state.mix.a.shape == "Red stool"
        assert [state.scene for state in window.editor.history.states[: len(made.history.states)]] == [
            state.scene for state in made.history.states
        ]
        window.undo()
        window.undo()
        assert window.editor.model.category == "stools"
        assert window.session.messages.errors == []

    drive(act, file_backend, folder=tmp_path / "config")
    again = read_project(tmp_path / "b.codenerf").adopted(loaded(file_backend, moved))
    assert [added.instance for added in again.objects] == [added.instance for added in made.objects]
    assert again.history.states == made.history.states


def loaded(backend: Backend, path: Path) -> OpenModels:
    models = OpenModels(backend.load_model)
    for name in ("chairs", str(path)):
        models.open(name)
    return models


def test_it_is_back_at_the_next_launch_once_its_file_is(
    drive: Drive, file_backend: Backend, made: Project, stools: Path
) -> None:
    folder = stools.parent / "config"
    aside = stools.rename(stools.with_name("aside"))

    def without(window: Driver) -> None:
        assert window.editor.objects.is_missing("Red stool")
        window.menu("File/###new_project")  # what is mine stays
        assert window.editor.objects.own == ["Red stool"]
        assert window.editor.objects.is_missing("Red stool")

    def back(window: Driver) -> None:
        assert window.session.messages.all == []
        window.click("Library/**/show Red stool")
        assert window.editor.scene.instance == made.objects[0].instance
        assert window.editor.objects.own == ["Red stool"]

    drive(without, file_backend, folder=folder)
    aside.rename(stools)
    drive(back, file_backend, folder=folder)


def test_a_tile_asks_for_no_file_that_is_back_and_refuses_another_model(
    drive: Drive, file_backend: Backend, made: Project, stools: Path
) -> None:
    aside = stools.rename(stools.with_name("aside"))
    random_model(11).save(stools.with_name("tables.safetensors"))

    def act(window: Driver) -> None:
        window.context.drop([str(stools.with_name("a.codenerf"))])
        window.wait()
        window.choose("Red stool", "###find model")
        window.type(str(stools.with_name("tables.safetensors")))
        window.wait()
        assert window.session.messages.errors == [
            "tables.safetensors is another model than stools.safetensors: choose the one from then"
        ]
        assert window.editor.objects.is_missing("Red stool") and len(list(window.session.models)) == 1
        aside.rename(stools)
        window.click("Library/**/show Red stool")
        window.wait()
        assert window.editor.state.mix.a.shape == "Red stool"

    drive(act, file_backend)


def test_a_branch_of_a_missing_model_is_grey_and_found_by_a_click(
    drive: Drive, file_backend: Backend, worker: Worker, stools: Path
) -> None:
    session = Session(worker, file_backend, 0)
    path = stools.with_name("a.codenerf")
    editor = session.editor
    model = session.models.open(str(stools))
    session.tick()
    editor.show_object("object 2")
    editor.show_object(editor.objects.add(EditableObject("Red stool", model[1], True, 0.8)))
    made = editor.scene
    editor.undo()
    editor.show_object("object 3")
    assert session.save_project(path)
    moved = stools.rename(stools.with_name("elsewhere.safetensors"))

    def act(window: Driver) -> None:
        window.context.drop([str(path)])
        window.wait()
        editor = window.editor
        assert editor.state.mix.a.shape == "object 3"
        find(window, "History/branch 1", moved)
        assert editor.scene == made
        assert window.session.messages.errors == []

    drive(act, file_backend)
