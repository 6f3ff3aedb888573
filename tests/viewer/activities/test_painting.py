from collections.abc import Generator
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from core.editing.paint import CoarsePaint, Paint
from core.editing.parts import Handle, PartMap
from core.edits.paint import PartPaint
from core.models.model import Instance
from tests.viewer.driver import finish
from tests.viewer.stand_ins import quick_colour, quick_paint
from tests.viewer.test_editor import fitted
from viewer.activities.painting import Painting
from viewer.activities.reshaping import Reshaping
from viewer.editor import Editor
from viewer.session import Session
from viewer.values.direction import Direction


@pytest.fixture
def painted(session: Session) -> Session:
    """With a paint that is found at once."""
    session.jobs.backend = replace(session.jobs.backend, paint=quick_paint, paint_colour=quick_colour)
    return session


def colour_of(editor: Editor) -> tuple[float, float, float]:
    """The colour of the last paint."""
    return editor.scene.instance.codes.of_kind(PartPaint)[-1].colour


def test_a_drag_over_colours_shows_in_the_frame_and_is_one_step_with_the_last(painted: Session, editor: Editor) -> None:
    coarse = CoarsePaint(np.zeros((32, 32, 3), np.float32), np.ones((32, 32), np.float32), (0.0, 0.0, 0.0))
    painted.jobs.backend = replace(painted.jobs.backend, coarse_paint=lambda *_: coarse)
    painting = painted.painting
    finish(painted)
    scene = editor.scene
    past = len(editor.history.past)
    painting.paint((0.1, 0.0, 0.0))
    finish(painted)
    for red in (0.2, 0.6, 1.0):
        painting.paint((red, 0.0, 0.0))
        assert painting.colour == (red, 0.0, 0.0)
        assert painted.viewport.repainted is not None
        assert painted.viewport.repainted.image[0, 0].tolist() == [round(255 * red), 0, 0]
    assert editor.scene is scene
    painting.release()
    finish(painted)
    assert colour_of(editor) == painting.colour == (1.0, 0.0, 0.0)
    assert len(editor.history.past) == past + 1
    finish(painted)
    assert painted.viewport.repainted is None  # the object itself is on screen


def test_a_paint_that_fails_is_reported(painted: Session, editor: Editor) -> None:
    def fails(instance: Instance, new_paint: Paint) -> Generator[None, None, Instance]:
        yield None
        raise ValueError("no surface")

    painted.jobs.backend = replace(painted.jobs.backend, paint=fails)
    painted.painting.paint((0.9, 0.0, 0.0))
    painted.painting.release()
    finish(painted)
    assert painted.painting.colour is None and editor.scene.instance.codes.of_kind(PartPaint) == ()
    assert painted.messages.errors == ["Cannot paint: no surface"]


@pytest.mark.parametrize("interrupt", ["show", "undo"])
def test_a_colour_that_comes_too_late_changes_nothing(painted: Session, editor: Editor, interrupt: str) -> None:
    editor.edit(Direction.principal(editor.model.codes, "shape", 0).moved(editor.scene.instance, 1.5))
    painted.painting.paint((0.1, 0.0, 0.0))
    if interrupt == "show":
        editor.show_object("object 4")
    painted.painting.release()
    if interrupt == "undo":
        editor.undo()
    state = editor.state
    finish(painted)
    assert editor.state is state
    assert interrupt == "undo" or "paint again" in painted.messages.all[-1].text


def test_a_colour_that_comes_after_a_reshaping_paints_the_new_shape(painted: Session, editor: Editor) -> None:
    direction = Direction.principal(editor.model.codes, "shape", 0)
    painted.painting.paint((0.1, 0.0, 0.0))
    painted.painting.release()
    editor.edit(direction.moved(editor.scene.instance, 1.5))
    reshaped = editor.scene.instance.codes.shape
    finish(painted)
    assert colour_of(editor)[0] == 0.1
    assert torch.equal(editor.scene.instance.codes.shape, reshaped)


def test_the_original_comes_back(painted: Session, editor: Editor) -> None:
    painting = painted.painting
    added = fitted(editor.model)
    editor.add_and_show(added, editor.scene.camera)
    assert painting.is_original
    painting.paint((0.5, 0.5, 0.0))
    painting.release()
    finish(painted)
    assert not painting.is_original
    painting.restore()
    assert painting.is_original
    assert editor.scene.instance == added.instance


def test_the_colour_is_told_once_it_is_known(painted: Session, editor: Editor) -> None:
    painting = painted.painting
    assert painting.colour is None
    finish(painted)
    assert painting.colour == pytest.approx(editor.scene.instance.codes.texture[:3].clamp(0, 1).tolist())
    editor.show_object("object 3")
    assert painting.colour is None  # there is no frame of it yet
    finish(painted)
    assert painting.colour is None  # it is being measured
    finish(painted)
    assert painting.colour == pytest.approx(editor.scene.instance.codes.texture[:3].clamp(0, 1).tolist())


def test_a_painted_colour_stays_known_after_another_edit(painted: Session, editor: Editor) -> None:
    painting = painted.painting
    assert painting.colour is None  # it is being measured
    painting.paint((0.9, 0.0, 0.0))
    painting.release()
    finish(painted)
    editor.edit(Direction.principal(editor.model.codes, "shape", 0).moved(editor.scene.instance, 1.0))
    assert painting.colour == (0.9, 0.0, 0.0)


def test_parts_painted_in_a_row_all_take_the_paint(painted: Session, editor: Editor, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(Painting, "parts", ("seat", "legs"))

    def paint(instance: Instance, new_paint: Paint) -> Generator[None, None, Instance]:
        yield None
        added = PartPaint(new_paint.part, new_paint.colour, (0.5, 0.5, 0.5))
        return instance.changed(edits=(*instance.codes.edits, added))

    painted.jobs.backend = replace(painted.jobs.backend, paint=paint)
    painting = painted.painting
    past = len(editor.history.past)
    painting.part = "seat"
    painting.paint((0.1, 0.0, 0.0))
    painting.release()
    painting.part = "legs"
    for red in (0.3, 0.6):
        painting.paint((red, 0.0, 0.0))
    painting.release()
    finish(painted)
    paints = editor.scene.instance.codes.of_kind(PartPaint)
    assert [(added.part, added.colour[0]) for added in paints] == [("seat", 0.1), ("legs", 0.6)]
    assert len(editor.history.past) == past + 2
    painting.paint((0.9, 0.0, 0.0))
    painting.release()
    painting.restore()
    finish(painted)
    assert painting.is_original and editor.scene.instance.codes.of_kind(PartPaint) == ()


def test_the_largest_part_is_painted_until_another_is_chosen(painted: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    handles = tuple(Handle(part_name, (0.5, 0.5), (0.0, 0.0, 0.0)) for part_name in ("seat", "legs"))
    visible = SimpleNamespace(map=PartMap(handles, np.array([[0, 1, 1], [-1, 0, 1]])))
    monkeypatch.setattr(Painting, "parts", ("seat", "legs"))
    monkeypatch.setattr(Reshaping, "parts", None)
    painting = painted.painting
    assert painting.part == "seat"
    monkeypatch.setattr(Reshaping, "parts", visible)
    assert painting.part == "legs"
    visible.map = PartMap(handles, np.array([[0, 0, 0], [-1, 0, 1]]))
    assert painting.part == "legs"  # a turn of the object changes no choice
    painting.part = "seat"
    assert painting.part == "seat"
