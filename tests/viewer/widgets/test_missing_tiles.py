from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imgui_bundle import imgui

from core.models.model import Model
from core.models.open_models import OpenModels
from tests.conftest import random_model
from tests.viewer.driver import Drive, Driver
from viewer.autosave import Autosave
from viewer.services.backend import Backend
from viewer.services.worker import Worker
from viewer.session import Session
from viewer.values.objects import EditableObject
from viewer.values.project import Project


@pytest.fixture
def stools(tmp_path: Path) -> Path:
    """The file of a person's own model."""
    model = replace(random_model(9), category="stools")
    model.save(tmp_path / "stools.safetensors")
    return tmp_path / "stools.safetensors"


@pytest.fixture
def own(backend: Backend, model: Model) -> Backend:
    """The shipped model, and models of files."""
    return replace(backend, load_model=lambda name: Model.load(Path(name)) if Path(name).suffix else model)


def make(session: Session, stools: Path) -> None:
    """A chair, a fitted stool, an edit of the stool, and a chair again, all of them keyframes."""
    editor = session.editor
    editor.show_object("object 2")
    session.player.add_key()
    model = session.models.open(str(stools))
    session.tick()
    name = editor.objects.add(EditableObject("Red stool", model.codes[1], True, 0.8))
    editor.show_object(name)
    session.player.seek(1.0)
    editor.show_object(name)
    session.player.add_key()
    editor.mix_both(0.0, 0.5)
    editor.show_object("object 3")
    session.tick()


@pytest.fixture
def made(worker: Worker, own: Backend, stools: Path, tmp_path: Path) -> Project:
    """A project with them in ``a.codenerf``, and the same kept in a folder for the next launch."""
    folder = tmp_path / "config"
    folder.mkdir()
    session = Session(worker, own, 0, folder)
    autosave = Autosave(session, folder)
    make(session, stools)
    session.save_project(tmp_path / "a.codenerf")
    autosave.close()
    assert session.messages.errors == []
    return session.project()


def find(window: Driver, widget: str, path: Path) -> None:
    """Click a grey tile and answer with the path of the model."""
    window.click(widget)
    window.type(str(path))
    window.wait()


def test_what_was_made_with_a_deleted_model_waits_as_grey_tiles_and_comes_back(
    drive: Drive, own: Backend, made: Project, stools: Path, tmp_path: Path
) -> None:
    moved = stools.rename(tmp_path / "elsewhere.safetensors")

    def act(window: Driver) -> None:
        session, editor = window.session, window.session.editor
        assert session.messages.errors == []
        assert any("stools.safetensors" in message.text for message in session.messages.shown)
        assert editor.state.mix.a.shape == "object 3"
        assert editor.objects.own == ["Red stool"]
        tile = window.ctx.item_info("//Library/**/show Red stool").rect_full
        grey = window.capture()[int(tile.min.y) + 3 : int(tile.min.y) + 20, int(tile.min.x) + 3 : int(tile.max.x) - 3]
        assert np.ptp(grey, -1).max() < 16  # no picture, no colour
        window.undo()
        assert editor.state.mix.a.shape == "object 2"  # the states of the stool are skipped
        window.redo()
        assert editor.state.mix.a.shape == "object 3"
        assert session.save_project(tmp_path / "b.codenerf")
        find(window, "Library/**/show Red stool", moved)
        assert editor.state.mix.a.shape == "Red stool"
        assert [state.scene for state in editor.history.states[: len(made.history.states)]] == [
            state.scene for state in made.history.states
        ]
        window.undo()
        window.undo()
        assert editor.model.category == "stools"
        assert len(editor.playable.keys) == 2
        assert session.messages.errors == []

    drive(act, own, folder=tmp_path / "config")
    again = Project.load(tmp_path / "b.codenerf", loaded(own, moved))
    assert [one.codes for one in again.objects] == [one.codes for one in made.objects]
    assert again.history.states == made.history.states


def loaded(backend: Backend, path: Path) -> OpenModels:
    models = OpenModels(backend.load_model)
    for name in ("chairs", str(path)):
        models.open(name)
    return models
