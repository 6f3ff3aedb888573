from dataclasses import replace

import pytest

from core.models.model import Model
from core.models.scene import Scene
from viewer.values.history import History, Mix, Pair, State


@pytest.fixture
def states(model: Model) -> list[State]:
    return [
        State(Scene(model.codes[0], model.camera(0.1 * n, 0)), Mix(Pair("a", "a"), "b", shape=0.1 * n))
        for n in range(6)
    ]


def test_undo_and_redo_go_back_and_forth(states: list[State]) -> None:
    history = History(states[0])
    for state in states[1:]:
        history = history.changed(state)
    for state in states[-2::-1]:
        history = history.undone()
        assert history.now == state
    assert history.undone() == history
    for state in states[1:]:
        history = history.redone()
        assert history.now == state
    assert history.redone() == history


def test_a_gesture_is_one_step(states: list[State]) -> None:
    history = History(states[0])
    for state in states[1:4]:
        history = history.changed(state, "orbit")
    history = history.without_gesture().changed(states[4], "orbit").changed(states[5], "zoom")
    assert history.past == (states[0], states[3], states[4])


def test_an_edit_ends_redo_and_no_change_is_none(states: list[State]) -> None:
    history = History(states[0]).changed(states[1]).undone().changed(states[2])
    assert history.future == ()
    assert history.undone().now == states[0]
    history = History(states[0]).changed(states[1]).undone()
    same = State(replace(states[0].scene), replace(states[0].mix))
    assert history.changed(same) is history


def test_any_state_can_be_gone_to_and_none_is_lost(states: list[State]) -> None:
    history = History(states[0])
    for state in states[1:]:
        history = history.changed(state)
    history = history.undone()
    for index, state in enumerate(states):
        there = history.at(index)
        assert (there.now, len(there.past), there.states) == (state, index, tuple(states))


def test_edits_are_grouped_by_object_and_what_changes_no_code_is_none(states: list[State], model: Model) -> None:
    first = states[0]
    moved = replace(first, scene=replace(first.scene, camera=model.camera(1.0, 0.5)))
    other_b = replace(moved, mix=replace(moved.mix, b="c"))
    shown = State(replace(first.scene, codes=model.codes[1]), Mix(Pair("b", "b"), "c"))
    mixed = State(replace(first.scene, codes=model.codes[2]), replace(shown.mix, shape=0.5))
    back = State(first.scene, first.mix)
    history = History(first)
    for state in (moved, other_b, shown, mixed, back):
        history = history.changed(state)
    assert [[(edit.last, edit.words) for edit in group] for group in history.edits] == [
        [(2, "at first")],
        [(3, "b"), (4, "c mixed in: shape 50%, texture 0%")],
        [(5, "a")],
    ]
