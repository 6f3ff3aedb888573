from pathlib import Path

import pytest
import torch
from PIL import Image

from tests.viewer.driver import finish
from viewer.editor import Editor
from viewer.services.backend import Backend
from viewer.services.worker import Worker
from viewer.session import Session


def test_the_grid_crosses_shapes_with_textures(session: Session, editor: Editor, tmp_path: Path) -> None:
    session.grid.add("object 1", "object 2")
    session.grid.add("object 2", "object 4")
    assert session.grid.names == ("object 1", "object 2", "object 4")
    editor.show_pair(session.grid.rows[0][2])
    assert torch.equal(editor.code("shape"), editor.objects["object 1"].codes.shape)
    assert torch.equal(editor.code("texture"), editor.objects["object 4"].codes.texture)
    session.grid.remove("object 2")
    assert [pair.texture for pair in session.grid.rows[1]] == ["object 1", "object 4"]
    session.exporting.grid(tmp_path / "grid.png", size=16)
    finish(session)
    with Image.open(tmp_path / "grid.png") as image:
        assert image.size == (32, 32)
    session.grid.clear()
    session.exporting.grid(tmp_path / "empty.png")
    assert not session.exporting.running
    session.grid.add(*editor.objects.names, *(f"object {n}" for n in range(6)))
    assert len(session.grid.names) == 6


def test_objects_that_the_grid_has_no_room_for_are_reported(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("viewer.activities.grid.MAX_OBJECTS", 2)
    session.grid.add("object 1", "object 2")
    assert session.messages.all == []
    session.grid.add("object 2", "object 3")
    assert session.grid.names == ("object 1", "object 2")
    assert session.messages.all[-1].text == "A grid holds 2 objects; there is no room for object 3"


def test_a_grid_that_cannot_be_written_is_reported(session: Session, tmp_path: Path) -> None:
    session.grid.add("object 1")
    for name in ("grid.xyz", "missing/grid.png"):
        session.messages.clear()
        session.exporting.grid(tmp_path / name, size=16)
        finish(session)
        assert len(session.messages.errors) == 1, name
    assert list(tmp_path.iterdir()) == []


def test_objects_of_another_model_begin_it_anew(worker: Worker, both: Backend) -> None:
    session = Session(worker, both, seed=0)
    session.grid.add("object 1", "object 2")
    session.grid.add("car 3")
    assert session.grid.names == ("car 3",)
    assert session.messages.all[-1].text.startswith("The grid begins anew: object 1")
    session.grid.add("car 1")
    assert session.grid.names == ("car 3", "car 1")
